"""Watch with a frame camera: its picture full size follows the cursor, and the scene comes back."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.modes.watch.commands import EnlargeCamera, ShowSpace
from app.server import App
from app.session import Session
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.state.commands import SetMode, StopAt
from benchmarks.app.bare_browser import BareBrowser
from core.detection import Detection
from core.events import Window
from tests.frames_beside_events import EVENT_CAMERAS, FRAMES, GREY, write_frames_beside_events
from tests.waiting import PATIENCE_S, eventually

BALL_PX = (600.0, 300.0)


class BallInPictures:
    """A ball in every picture, and none in events."""

    extra_circles = 0

    def reset(self) -> None: ...

    def step(self, window: Window) -> Detection | None:
        return None if window.frame is None else Detection(window.frame.t_us, *BALL_PX, 8.0)


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """A browser that shows the recording, all of which the chain has followed."""
    workspace = Workspace(tmp_path / "data")
    write_frames_beside_events(workspace.recording_path("frames"))
    lab = App(workspace, Library(workspace), "frames", host="127.0.0.1", port=0)
    lab.services.rallies.followings.frame_detector = BallInPictures
    browser = BareBrowser(lab.port)
    session = browser.wait_session(lab, PATIENCE_S)
    recording = session.recording
    assert recording is not None
    rally = lab.services.rallies.of(recording)
    assert rally is not None and rally.following is not None
    rally.following.wait()
    yield session
    browser.close()
    lab.stop()


def title(session: Session) -> str:
    """What the sheet in the middle says it is."""
    return next((text.text for text in session.sheet.texts if text.is_title), "")


def test_a_frame_camera_that_is_followed_is_shown_full_size_at_the_cursor(session: Session) -> None:
    state = session.state
    assert state is not None and state.seen_cameras == (*EVENT_CAMERAS, FRAMES)
    session.send(StopAt(30_000))
    session.send(EnlargeCamera(FRAMES))
    eventually(lambda: title(session) == f"{FRAMES}: picture 1, mid exposure 25.000 ms", "the picture of 25 ms")
    (tile,) = session.sheet.pictures
    drawn = np.argwhere((np.asarray(Image.open(io.BytesIO(tile.png)).convert("RGB")) != GREY).any(axis=2))
    assert np.abs(drawn.mean(axis=0) - BALL_PX[::-1]).max() < 1, "the circle that the chain found in it"
    session.send(StopAt(3_000))
    eventually(lambda: title(session) == f"{FRAMES}: no picture yet", "to hear that no exposure is over")
    session.send(StopAt(50_000))
    eventually(lambda: title(session).startswith(f"{FRAMES}: picture 2,"), "the picture of 45 ms")


def test_after_it_an_event_camera_and_the_scene_come_back(session: Session) -> None:
    session.send(EnlargeCamera(FRAMES))
    eventually(lambda: title(session).startswith(FRAMES), "its picture")
    session.send(EnlargeCamera(EVENT_CAMERAS[0]))
    eventually(lambda: title(session).startswith(EVENT_CAMERAS[0]), "the events of another camera")
    session.send(EnlargeCamera(FRAMES))
    eventually(lambda: title(session).startswith(FRAMES), "its picture, though it is the one that was shown before")
    session.send(EnlargeCamera(FRAMES))
    eventually(lambda: session.world.visible, "the scene")


def test_among_all_pictures_it_stands_behind_the_event_cameras(session: Session) -> None:
    session.send(StopAt(30_000))
    session.send(ShowSpace(False))

    def names() -> list[str]:
        titles = [text for text in session.sheet.texts if text.is_title]
        # Why there is no ball stands below, in another colour.
        return [text.text.partition(":")[0] for text in titles if text.colour == titles[0].colour]

    eventually(lambda: names() == [*EVENT_CAMERAS, FRAMES], "three pictures")
    session.send(SetMode("Export"))
    eventually(lambda: names() == [*EVENT_CAMERAS], "the event cameras, which are exported")
