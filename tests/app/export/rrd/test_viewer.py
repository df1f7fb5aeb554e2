"""Streaming to a Rerun viewer: here one that saves what it is sent."""

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from app.export.rrd.recording import RrdContents, export_rrd
from app.export.rrd.viewer import LIVE_PART_US, stream_live, stream_recording
from app.export.selection import Span
from app.export.unfinished import ExportCancelledError
from core.cameras import stereo_preset
from core.errors import CommandError
from core.events import SensorSize
from core.rally.link.client import SimulationClient
from core.rally.link.server import ServerConfig, SimulationServer
from core.rally.live.ring_recording import RingRecording
from core.recordings import open_recording

SPAN = Span(200_000, 300_000)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def viewer(saved: Path) -> Iterator[tuple[str, subprocess.Popen]]:
    """A viewer without a window that writes what it is sent to a file."""
    port = free_port()
    command = [sys.executable, "-m", "rerun", "--save", str(saved), "--bind", "127.0.0.1", "--port", str(port)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, start_new_session=True, **quiet)
    try:
        until_s = time.monotonic() + 60
        while not is_open(port):
            assert time.monotonic() < until_s and process.poll() is None, "the viewer did not start"
            time.sleep(0.1)
        yield f"rerun+http://127.0.0.1:{port}/proxy", process
    finally:
        end(process)


def end(process: subprocess.Popen) -> None:
    """With its own child: `python -m rerun` starts the viewer as one."""
    if process.poll() is None:
        os.killpg(process.pid, 15)
    process.wait(30)


def entities(path: Path) -> set[str]:
    command = [sys.executable, "-m", "rerun", "rrd", "stats", str(path)]
    section = subprocess.run(command, capture_output=True, text=True, timeout=120).stdout.partition(
        "Num chunks per entity"
    )[2]
    found = {line.partition(":")[0].strip("/") for line in section.splitlines() if line.startswith("/")}
    return {one for one in found if one.startswith(("world", "pictures", "plots"))}  # not the views, which are made anew


def test_a_viewer_is_sent_what_the_file_would_hold(serve_recording: Path, tmp_path: Path) -> None:
    with open_recording(serve_recording) as recording:
        export_rrd(recording, tmp_path / "file.rrd", SPAN, RrdContents(), groups=recording.read_rows)
        with viewer(tmp_path / "seen.rrd") as (address, _):
            shares: list[float] = []
            stream_recording(
                recording, address, SPAN, RrdContents(), name="serve", groups=recording.read_rows,
                progress=shares.append,
            )  # fmt: skip
    expected = entities(tmp_path / "file.rrd")
    assert {"world/ball/triangulated", "world/cameras/left/picture", "plots/event_rate/left"} <= expected
    assert entities(tmp_path / "seen.rrd") == expected and shares[-1] == 1.0


def test_where_no_viewer_is_one_line_says_so(serve_recording: Path) -> None:
    address = f"rerun+http://127.0.0.1:{free_port()}/proxy"
    with open_recording(serve_recording) as recording, pytest.raises(CommandError) as caught:
        stream_recording(recording, address, SPAN, RrdContents(), name="serve")
    assert "no Rerun viewer answers" in str(caught.value) and address in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_live_rally_is_sent_until_somebody_stops_it_or_the_viewer_is_lost(tmp_path: Path) -> None:
    small = stereo_preset("side", SensorSize(640, 360))
    server = SimulationServer(ServerConfig(), small, "tcp://127.0.0.1:0", seed=5)
    ended, enough = threading.Event(), threading.Event()
    thread = threading.Thread(target=server.run, args=(ended.is_set,))
    thread.start()
    ring, client = RingRecording(), None
    try:
        client = SimulationClient(server.address)
        client.add_listener(ring)
        client.set_speed(0.3)
        client.auto_serve(5.0)
        contents = RrdContents(stride_us=20_000, stages=False)
        with viewer(tmp_path / "live.rrd") as (address, process):
            until_us = ring.duration_us + 4 * LIVE_PART_US
            stopper = threading.Thread(target=set_when, args=(enough, lambda: ring.duration_us > until_us))
            stopper.start()
            with pytest.raises(ExportCancelledError):
                stream_live(ring, address, contents, name="live", cancelled=enough.is_set)
            stopper.join()
            lost_us = ring.duration_us + 2 * LIVE_PART_US
            killer = threading.Thread(target=lambda: (wait(lambda: ring.duration_us > lost_us), end(process)))
            killer.start()
            with pytest.raises(CommandError, match="the Rerun viewer is lost") as caught:
                stream_live(ring, address, contents, name="live")
            killer.join()
            assert "\n" not in str(caught.value)
        assert {"world/ball/triangulated", "world/cameras/left/picture", "plots/event_rate/left"} <= entities(
            tmp_path / "live.rrd"
        )
    finally:
        if client is not None:
            client.close()
        ended.set()
        thread.join()


def wait(true) -> None:
    until_s = time.monotonic() + 120
    while not true():
        assert time.monotonic() < until_s, "it did not happen in time"
        time.sleep(0.02)


def set_when(event: threading.Event, true) -> None:
    wait(true)
    event.set()
