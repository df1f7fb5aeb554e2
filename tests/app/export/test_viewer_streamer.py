"""The one stream to a viewer."""

import threading

import pytest

from app.export.unfinished import ExportCancelledError
from app.export.viewer_streamer import ViewerStreamer, check_viewer_address
from core.errors import CommandError
from tests.waiting import PATIENCE_S, eventually

ADDRESS = "rerun+http://127.0.0.1:9876/proxy"


@pytest.mark.parametrize("address", [ADDRESS, "rerun://viewer.local:80/proxy", "rerun+https://[::1]:9876/proxy"])
def test_an_address_of_a_viewer_is_taken(address: str) -> None:
    assert check_viewer_address(address) == address


@pytest.mark.parametrize(
    "address",
    ["", "http://127.0.0.1:9876/proxy", "rerun+http://127.0.0.1/proxy", ADDRESS + "?x", "rerun+http://a b:1/proxy"],
)
def test_anything_else_is_answered_in_one_line(address: str) -> None:
    with pytest.raises(CommandError, match="not a Rerun viewer") as caught:
        check_viewer_address(address)
    assert "--rerun" in str(caught.value)


def test_one_stream_at_a_time_which_says_how_it_goes_and_ends() -> None:
    streamer, go_on = ViewerStreamer(ADDRESS), threading.Event()
    assert streamer.state() is None

    def work(progress, cancelled, remark) -> None:
        progress(0.5)
        remark("slow")
        assert go_on.wait(PATIENCE_S)

    streamer.start("rally", work)
    eventually(lambda: streamer.state().message == "slow", "the remark")
    assert streamer.state().running and streamer.state().share == 0.5
    with pytest.raises(CommandError, match="already"):
        streamer.start("other", work)
    go_on.set()
    eventually(lambda: not streamer.state().running, "the stream to end")
    assert streamer.state().message == "rally: all of it was sent" and not streamer.state().failed


def test_a_stream_is_stopped_and_a_lost_viewer_is_one_line() -> None:
    streamer = ViewerStreamer(ADDRESS)

    def for_ever(progress, cancelled, remark) -> None:
        eventually(cancelled, "somebody to stop it")
        raise ExportCancelledError

    def lost(progress, cancelled, remark) -> None:
        raise CommandError("the Rerun viewer is lost", where=ADDRESS)

    streamer.start("rally", for_ever)
    streamer.stop()
    assert streamer.state().message == "rally: stopped" and not streamer.state().running
    eventually(lambda: not streamer._job.running, "the job to end")
    streamer.start("rally", lost)
    eventually(lambda: not streamer.state().running, "the stream to end")
    assert streamer.state().failed and "the Rerun viewer is lost" in streamer.state().message
    assert "\n" not in streamer.state().message
    streamer.close()
