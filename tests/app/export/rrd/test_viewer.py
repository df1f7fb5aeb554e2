"""Streaming to a Rerun viewer: here one that saves what it is sent."""

import contextlib
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from app.export.rrd.recording import RrdContents, export_rrd
from app.export.rrd.viewer import LIVE_PART_US, stream_live, stream_recording
from app.export.selection import Span
from app.export.unfinished import ExportCancelledError
from core.cameras import stereo_preset
from core.errors import CommandError
from core.events import SensorSize
from core.live.link.client import SimulationClient
from core.live.link.server import ServerConfig, SimulationServer
from core.live.ring_recording import RingRecording
from core.recordings import open_recording
from tests.app.export.rrd.rerun_viewer import end, entities, viewer
from tests.app.export.tasks import task_of
from tests.simulation_servers import serving
from tests.waiting import eventually

SPAN = Span(200_000, 300_000)


@pytest.mark.gate
def test_a_viewer_is_sent_what_the_file_would_hold(serve_recording: Path, tmp_path: Path) -> None:
    with open_recording(serve_recording) as recording:
        export_rrd(task_of(recording, tmp_path / "file.rrd", SPAN))
        with viewer(tmp_path / "seen.rrd") as (address, _):
            shares: list[float] = []
            stream_recording(
                recording, address, SPAN, RrdContents(), name="serve", groups=recording.read_rows,
                progress=shares.append,
            )  # fmt: skip
            expected = entities(tmp_path / "file.rrd")
            assert {"world/ball/triangulated", "world/cameras/left/picture", "plots/event_rate/left"} <= expected
            eventually(lambda: entities(tmp_path / "seen.rrd") >= expected, "the viewer to write all")  # at its leisure
    assert entities(tmp_path / "seen.rrd") == expected and shares[-1] == 1.0


def test_where_no_viewer_is_one_line_says_so(serve_recording: Path) -> None:
    with socket.socket() as nobody, open_recording(serve_recording) as recording:
        nobody.bind(("127.0.0.1", 0))  # and does not listen: nobody else can meanwhile
        address = f"rerun+http://127.0.0.1:{nobody.getsockname()[1]}/proxy"
        with pytest.raises(CommandError) as caught:
            stream_recording(recording, address, SPAN, RrdContents(), name="serve")
    assert "no Rerun viewer answers" in str(caught.value) and address in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_live_rally_is_sent_until_somebody_stops_it_or_the_viewer_is_lost(tmp_path: Path) -> None:
    small = stereo_preset("side", SensorSize(640, 360))
    server = SimulationServer(ServerConfig(), small, "tcp://127.0.0.1:0", seed=5)
    enough, ring = threading.Event(), RingRecording()
    with serving(server), contextlib.closing(SimulationClient(server.address)) as client:
        client.add_listener(ring)
        client.set_speed(0.3)
        client.auto_serve(5.0)
        contents = RrdContents(stride_us=20_000, stages=False)
        with viewer(tmp_path / "live.rrd") as (address, process):
            until_us = ring.duration_us + 4 * LIVE_PART_US
            until = lambda: ring.duration_us > until_us  # noqa: E731
            stopper = threading.Thread(target=set_when, args=(enough, until, "four parts of the rally"))
            stopper.start()
            with pytest.raises(ExportCancelledError):
                stream_live(ring, address, contents, name="live", cancelled=enough.is_set)
            stopper.join()
            lost_us = ring.duration_us + 2 * LIVE_PART_US

            def end_later() -> None:
                eventually(lambda: ring.duration_us > lost_us, "two more parts")
                end(process)

            killer = threading.Thread(target=end_later)
            killer.start()
            with pytest.raises(CommandError, match="the Rerun viewer is lost") as caught:
                stream_live(ring, address, contents, name="live")
            killer.join()
            assert "\n" not in str(caught.value)
        assert {"world/ball/triangulated", "world/cameras/left/picture", "plots/event_rate/left"} <= entities(
            tmp_path / "live.rrd"
        )


def set_when(event: threading.Event, condition: Callable[[], object], what: str) -> None:
    eventually(condition, what)
    event.set()
