"""`rallyscope serve --robot` as a process: the robot is found, told to stand still at the end, and recorded."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import h5py
import numpy as np
import pytest

from app.shared.live_rally import LiveRally
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from core.robot import RobotClient, RobotServer, RobotWatchConfig
from tests.app.cli.printed_address import address_in
from tests.core.robot.limits import LIMITS
from tests.waiting import PATIENCE_S, eventually

PLACE = (-1.5, 0.125, 0.25)


@pytest.fixture
def standing() -> Iterator[RobotServer]:
    """A robot that stands somewhere."""
    server, ended = RobotServer("tcp://127.0.0.1:0", LIMITS, name="standing"), threading.Event()

    def run() -> None:
        while not ended.wait(0.003):
            server.turn(PLACE, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

    thread = threading.Thread(target=run)
    thread.start()
    yield server
    ended.set()
    thread.join()
    server.close()


@pytest.mark.gate
def test_a_robot_is_found_and_stopped_when_the_app_ends(standing: RobotServer, serve_recording, tmp_path) -> None:
    log = tmp_path / "log"
    words = ["serve", "--source", f"replay:{serve_recording}", "--robot", standing.address]
    with log.open("w") as out:
        command = [sys.executable, "-m", "app.cli", *words, "--port", "0", "--data", str(tmp_path / "data")]
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
    try:
        address_in(log, process)
        eventually(lambda: standing.offset_us is not None or process.poll() is not None, "their clocks to be compared")
        assert process.poll() is None, log.read_text()
        assert standing.stopped == "robot: not started yet: a person has to"
    finally:
        process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 0, log.read_text()
    by_the_app = "rallyscope: Rallyscope was ended"
    eventually(lambda: standing.stopped == by_the_app, "the robot to be stopped", lambda: standing.stopped)
    assert "Traceback" not in log.read_text()


def test_what_the_robot_tells_of_its_racket_is_shown_and_recorded(
    standing: RobotServer, serve_recording, tmp_path
) -> None:
    robot = RobotClient(standing.address, config=RobotWatchConfig(lost_ms=5000.0, slow_ms=2000.0))
    rally = LiveRally(ReplaySource(open_recording(serve_recording), "serve.h5"), robot=robot)
    try:
        assert rally.has_robot and rally.simulation is None
        eventually(lambda: rally.history.at(rally.recording.duration_us, {}).picture.racket is not None, "the racket")
        path, since_us = tmp_path / "rally.h5", rally.recording.duration_us
        rally.record(path)
        eventually(lambda: rally.recording.duration_us > since_us + 500_000, "half a second")
        assert rally.stop_recording() > 0
    finally:
        rally.close()
    with h5py.File(path) as file:
        rows = file["racket"]
        assert len(rows["t_us"]) > 10 and (np.diff(rows["t_us"]) >= 0).all()
        assert np.allclose(rows["p_world_m"], PLACE)
