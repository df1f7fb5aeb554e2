"""A recording that is replayed as live, in headless Chromium: no truth, no robot, and a camera that is lost."""

import re
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from app.state.commands import SetMethod
from core.errors import RecordingError
from core.events import Events
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from tests.app.browser.window import count_like
from tests.waiting import eventually

SPACE = (slice(0, 720), slice(320, 870))
TABLE_RGB = (48, 122, 202)


class Pluggable:
    """A camera of a recording whose plug can be pulled."""

    def __init__(self, stream) -> None:
        self._stream, self.pulled = stream, threading.Event()

    def __getattr__(self, name: str):
        return getattr(self._stream, name)

    def slice(self, start_us: int, end_us: int) -> Events:
        if self.pulled.is_set():
            raise RecordingError("unplugged")
        return self._stream.slice(start_us, end_us)


class PluggableRecording:
    """A recording with such cameras."""

    def __init__(self, recording) -> None:
        self._recording = recording
        self.duration_us = recording.duration_us
        self.cameras = {name: Pluggable(stream) for name, stream in recording.cameras.items()}

    def close(self) -> None:
        self._recording.close()


@pytest.fixture
def recording(serve_recording) -> PluggableRecording:
    return PluggableRecording(open_recording(serve_recording))


@pytest.fixture
def replay_lab(tmp_path, recording) -> Iterator[App]:
    workspace = Workspace(tmp_path)
    live = LiveRally(ReplaySource(recording, "serve.h5", speed=0.5))  # so that a busy machine is no part of the test
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    yield lab
    lab.stop()


def test_a_replayed_recording_is_watched_recorded_tuned_and_labelled_and_a_lost_camera_is_said(
    chromium, replay_lab, recording, open_window
) -> None:
    rally = replay_lab.services.rallies.live
    assert rally is not None
    with open_window(replay_lab, in_space=True) as window:
        page, session = window.page, window.session
        eventually(lambda: session.world.visible, "the 3D scene")
        eventually(lambda: rally.history.predicted_hits(), "the ball to be seen and predicted")
        page.get_by_text("There is no robot").wait_for()
        page.get_by_text("Hit predicted before the bounce").first.wait_for()
        for name in ("Serve", "Reset counts"):
            assert not page.get_by_role("button", name=name, exact=True).count()
        page.get_by_text("Layers", exact=True).click()
        page.get_by_text("Uncertainty", exact=True).wait_for()
        for said in ("Racket turned by", "Returned", "Pace", "True ball"):
            assert not page.get_by_text(said, exact=True).count()
        window.wait_for_pixels("replay-watch", lambda image: count_like(image, TABLE_RGB, 45) > 20_000, SPACE)
        picture = rally.history.at(rally.history.followed_us, {}).picture
        assert picture.racket is None and picture.racket_target is None and picture.truth is None

        window.press("Record")
        eventually(lambda: rally.recorded is not None, "the recording to begin")
        path, since_us = rally.recorded, rally.recording.duration_us
        eventually(lambda: rally.recording.duration_us > since_us + 700_000, "more than a round of the file")
        page.get_by_role("button", name="Stop recording").click()
        eventually(lambda: rally.recorded is None, "the recording to end")
        with open_recording(path) as recorded:
            assert recorded.ball is None and recorded.duration_us > 600_000
            assert all(one.event_count and one.truth is None for one in recorded.cameras.values())

        session.send(SetMethod("auto"))
        window.press("Tune")
        eventually(lambda: session.sheet.pictures, "the picture of Tune")
        page.get_by_text("circularity min").first.wait_for()
        assert page.get_by_text("found", exact=False).count() and not page.get_by_text("True ball", exact=True).count()
        window.screenshot("replay-tune")

        window.press("Label")
        mode = session._modes["Label"]
        eventually(lambda: mode._editor is not None and mode._pictures.shown is not None, "Label of the replay")
        session.later(lambda: mode._use_name("lena"))
        window.press("Pause")
        eventually(window.stands_in_label, "the cursor to stand")
        shown = mode._pictures.shown.plan.main
        live = rally.recording.cameras[mode._editor.labelling.view.camera].slice(*shown.window_us)
        page.keyboard.press("x")
        eventually(lambda: window.state.recording.startswith("live-"), "the frozen recording to open")
        eventually(lambda: mode._editor is not None and len(mode._editor.labelling.here.labels) == 1, "the label in it")
        now = mode._editor.labelling
        (label,) = now.here.labels.values()
        frozen = now.source.stream.slice(*label.provenance.window_us)
        assert len(live) == len(frozen) and np.array_equal(live.x_px, frozen.x_px), "the picture that was judged"
        window.screenshot("replay-label")

        session.open_recording(LIVE)
        window.press("Tune")
        eventually(lambda: window.state.recording == LIVE and window.state.playhead.following, "the replay again")
        recording.cameras["right"].pulled.set()
        page.get_by_text("Camera right is lost").wait_for()
        window.press("Watch")
        page.get_by_text("lost, no data for").wait_for()
        since_us = rally.history.followed_us
        eventually(lambda: rally.history.followed_us > since_us + 200_000, "the other camera to be followed")
        window.screenshot("replay-lost")


def test_strokes_of_a_replay_are_counted_as_they_were_seen(chromium, tmp_path, stroke_recording, open_window) -> None:
    path, told = stroke_recording
    workspace = Workspace(tmp_path)
    live = LiveRally(ReplaySource(open_recording(path), "stroke.h5", speed=0.3))
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    try:
        with open_window(lab, in_space=True) as window:
            eventually(lambda: window.session.world.visible, "the 3D scene")
            eventually(lambda: live.history.outcome_count, "the stroke to be judged")
            window.page.get_by_text("Strokes, as seen").first.wait_for()
            window.page.get_by_text(re.compile(r"of [1-9]\d* returned")).first.wait_for()  # it is played in a loop
            window.screenshot("replay-strokes")
        (first, *_) = live.history.outcomes_between(-1, 10**12)
        assert first.spot.case == told.case
    finally:
        lab.stop()
