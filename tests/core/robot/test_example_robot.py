"""The robot of docs/examples in a process of its own plays balls that cameras saw; it is stopped, killed and back."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from core.errors import LinkError, TargetRefusedError
from core.live.link import messages as m
from core.live.live_player import LivePlayer
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from core.robot import RobotClient, RobotWatchConfig, SourceWithRobot
from core.robot.robot_client import host_us
from tests.core.robot.starting import start_until_answered
from tests.ports import lasting_address
from tests.waiting import PATIENCE_S, eventually

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "docs" / "examples" / "example_robot.py"
HOME = np.array([-1.6, 0.0, 0.25])


class ExampleProcess:
    """The script, and what it printed."""

    def __init__(self, address: str = "tcp://127.0.0.1:0") -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(EXAMPLE), address],
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        assert self._process.stdout is not None
        self.address = self._process.stdout.readline().strip()
        self.impacts_us: list[int] = []
        self.impacts_mps: list[float] = []
        self.impact_cameras: list[list[str]] = []
        """Names of the cameras behind each."""
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            for t_us, speed_mps, cameras in re.findall(r"^impact \d+ at (\d+) us, ([\d.]+) m/s( .*)?$", line):
                self.impacts_us.append(int(t_us))
                self.impact_cameras.append(cameras.split())
                self.impacts_mps.append(float(speed_mps))

    def send(self, number: int) -> None:
        self._process.send_signal(number)

    def kill(self) -> None:
        self._process.kill()
        self._process.wait(PATIENCE_S)


class RacketNotes:
    """Hears a source; keeps what it tells of the racket."""

    def __init__(self) -> None:
        self.rows: list[np.ndarray] = []

    def on_session(self, welcome: m.Reply) -> None: ...
    def on_events(self, batch: m.EventBatch) -> None: ...
    def on_notice(self, notice: m.Notice) -> None: ...

    def on_state(self, state: m.WorldState) -> None:
        assert not len(state.racket) or state.start_us <= state.racket_t_us[0] <= state.racket_t_us[-1] < state.t_us
        self.rows += list(state.racket)


@pytest.fixture
def example() -> Iterator[ExampleProcess]:
    example = ExampleProcess(lasting_address())
    yield example
    example.kill()


def test_the_example_is_short() -> None:
    assert len(EXAMPLE.read_text().splitlines()) <= 60


@pytest.mark.gate
def test_it_plays_balls_that_cameras_saw_is_stopped_killed_and_brought_back(example, serve_recording) -> None:
    config = RobotWatchConfig(lost_ms=1500.0, slow_ms=400.0)  # so that a busy machine is no part of the test
    client = RobotClient(example.address, config=config)
    source = SourceWithRobot(ReplaySource(open_recording(serve_recording), "serve.h5"), client)
    notes, player, again = RacketNotes(), LivePlayer(source), None
    source.add_listener(notes)

    def plays(one: ExampleProcess, more: int) -> None:
        wanted = len(one.impacts_mps) + more
        eventually(lambda: len(one.impacts_mps) >= wanted, f"{more} more impacts", lambda: client.status)

    def start() -> None:
        eventually(lambda: client.status.connection == "ready", "the robot", lambda: client.status)
        start_until_answered(client)
        eventually(lambda: client.status.stop is None, "the start")

    try:
        eventually(lambda: client.status.counts.not_ready > 3, "targets that do not leave before it is started")
        assert client.status.counts.sent == 0 and example.impacts_mps == []
        start()
        plays(example, 3)
        assert all(0.0 <= speed <= 5.0 for speed in example.impacts_mps) and client.status.counts.taken >= 3
        assert all(cameras == ["left", "right"] for cameras in example.impact_cameras), example.impact_cameras
        rows = np.array(notes.rows)
        assert rows[:, 0].max() > -1.55 and np.abs(rows[:, 7:]).max() > 0.1, "the racket went to the balls"

        client.stop("a visitor is too near")
        eventually(lambda: client.status.state.stopped == "rallyscope", "the robot to know")
        assert client.status.state.reason == "a visitor is too near"
        eventually(lambda: np.abs(client.status.state.v_mps).max() < 1e-6, "the racket to stand")
        sent, stood = client.status.counts.sent, client.status.state
        kept = client.status.counts.not_ready
        eventually(lambda: client.status.counts.not_ready > kept + 5, "balls that are not played")
        assert client.status.counts.sent == sent and max(example.impacts_us) <= stood.t_us  # a line may be read late
        assert client.status.state.p_m == stood.p_m, "it stands where it stopped"
        start()
        plays(example, 1)

        example.send(signal.SIGUSR1)
        eventually(lambda: client.status.stop is not None, "the red button")
        assert (client.status.stop.by, client.status.stop.reason) == ("robot", "the red button was pressed")
        start()
        plays(example, 1)

        lost = client.status.counts.lost
        example.send(signal.SIGSTOP)  # it hangs
        eventually(lambda: client.status.connection == "lost", "the loss")
        sent = client.status.counts.sent
        with pytest.raises(TargetRefusedError, match="nothing heard"):
            client.aim(HOME, (1, 0, 0, 0), (0, 0, 0), host_us() + 500_000)
        assert client.status.counts.lost > lost and client.status.counts.sent == sent
        example.send(signal.SIGCONT)
        eventually(lambda: client.status.ready, "it to be back, without a person")
        plays(example, 1)

        example.kill()
        eventually(lambda: client.status.connection == "lost", "the loss of the killed")
        again = ExampleProcess(example.address)
        eventually(lambda: client.status.connection == "ready", "the new one")
        assert client.status.stop is not None and "started anew" in client.status.stop.reason
        assert again.impacts_mps == []
        start()
        plays(again, 1)
    finally:
        player.close()
        source.close()
        if again is not None:
            again.kill()


def test_a_source_that_is_not_in_real_time_moves_no_robot(example, serve_recording) -> None:
    client = RobotClient(example.address, config=RobotWatchConfig(lost_ms=5000.0, slow_ms=2000.0))
    source = SourceWithRobot(ReplaySource(open_recording(serve_recording), "serve.h5", speed=0.5), client)
    source.add_listener(RacketNotes())
    try:
        eventually(lambda: client.status.connection == "ready", "the robot")
        start_until_answered(client)
        eventually(lambda: source.state is not None, "the source")
        with pytest.raises(TargetRefusedError, match="real time"):
            source.aim_racket((-1.42, 0.1, 0.3), (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0), source.state.t_us + 500_000)
        with pytest.raises(LinkError, match="a robot of its own"):
            SourceWithRobot(source, client)
        assert client.status.counts.sent == 0
    finally:
        source.close()
