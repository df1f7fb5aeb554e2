"""Frame cameras of a replay in the app: Watch shows their newest pictures, and what is frozen has them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.export.frozen import freeze, write_frozen
from app.export.selection import Span
from app.modes.watch.commands import EnlargeCamera, ShowSpace
from app.server import App
from app.session import Session
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from benchmarks.app.bare_browser import BareBrowser
from core.detection import Detection
from core.events import Window
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from tests.frames_beside_events import EVENT_CAMERAS, FRAMES, write_frames_beside_events
from tests.waiting import PATIENCE_S, eventually

LOOP_US = 60_000


class BallInPictures:
    """A ball in every picture."""

    extra_circles = 0

    def reset(self) -> None: ...

    def step(self, window: Window) -> Detection | None:
        return None if window.frame is None else Detection(window.frame.t_us, 600.0, 300.0, 8.0)


@pytest.fixture
def live(tmp_path: Path) -> Iterator[LiveRally]:
    """A slow replay of two event cameras and a frame camera, which goes round."""
    write_frames_beside_events(tmp_path / "frames.h5")
    source = ReplaySource(open_recording(tmp_path / "frames.h5"), "frames.h5", speed=0.2)
    rally = LiveRally(source, frame_detector=BallInPictures)
    yield rally
    rally.close()


def test_watch_shows_the_newest_picture_of_a_live_frame_camera(live: LiveRally, tmp_path: Path) -> None:
    workspace = Workspace(tmp_path / "data")
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    browser = BareBrowser(lab.port)
    session = browser.wait_session(lab, PATIENCE_S)

    def titles(session: Session = session) -> list[str]:
        return [text.text for text in session.sheet.texts if text.is_title]

    def newest() -> int:
        found = [re.match(rf"{FRAMES}: picture (\d+), mid exposure", title) for title in titles()]
        return max((int(one[1]) for one in found if one is not None), default=-1)

    def seen() -> tuple[str, ...]:
        return () if session.state is None else session.state.seen_cameras

    try:
        eventually(lambda: seen() == (*EVENT_CAMERAS, FRAMES), "the cameras, first those of events", seen)
        session.send(EnlargeCamera(FRAMES))
        eventually(lambda: newest() >= 3, "a picture of the next round, counted on", titles)
        session.send(EnlargeCamera(FRAMES))
        session.send(ShowSpace(False))
        names = [*EVENT_CAMERAS, FRAMES]
        eventually(lambda: [title.partition(":")[0] for title in titles()] == names, "the pictures of all cameras")
        assert {*live.cameras} == {*names}

        def found_in_pictures() -> bool:
            return any(FRAMES in step.circles for step in live.history.steps_between(0, live.history.followed_us))

        eventually(found_in_pictures, "what the chain finds in pictures", lambda: live.player.snapshot.health)
    finally:
        browser.close()
        lab.stop()


def test_what_is_frozen_has_the_pictures_of_its_time_from_its_own_start_on(live: LiveRally, tmp_path: Path) -> None:
    eventually(lambda: live.recording.duration_us >= 2 * LOOP_US, "two rounds")
    span = Span(20_000, LOOP_US + 20_000)
    frozen = freeze(live.recording, span)
    write_frozen(frozen, span, tmp_path / "frozen.h5", progress=lambda share: None, cancelled=lambda: False)
    with open_recording(tmp_path / "frozen.h5") as found, open_recording(tmp_path / "frames.h5") as file:
        pictures, known = found.frames[FRAMES], file.frames[FRAMES]
        assert pictures.t_us.tolist() == [5_000, 25_000, LOOP_US - 15_000]
        assert pictures.exposure_us.tolist() == [4_000] * 3
        np.testing.assert_array_equal(pictures.image(2), known.image(0))
        assert pictures.calibration is not None and known.calibration is not None
        np.testing.assert_array_equal(pictures.calibration.T_world_camera, known.calibration.T_world_camera)
        assert list(found.cameras) == list(EVENT_CAMERAS)
