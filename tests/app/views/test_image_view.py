"""The camera in front of the flat pictures, over the real connection."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from viser._messages import ViewerCameraMessage

from app.modes.watch.commands import ShowSpace
from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from benchmarks.app.bare_browser import BareBrowser
from tests.waiting import PATIENCE_S, eventually

Point = tuple[float, float, float]


class CameraOfBrowser(BareBrowser):
    """Notes where its camera is put, and reports what a test wants."""

    def __init__(self, port: int) -> None:
        self.put: list[Point] = []
        super().__init__(port)

    def _take(self, message: dict) -> None:
        if message["type"] == "SetCameraPositionMessage":
            self.put.append(tuple(message["position"]))
        super()._take(message)

    def report(self, position: Point, width: int) -> None:
        """The window is so wide, and the camera is there."""
        x, y, _ = position
        look_at, up = (x, y, 0.0), (0.0, -1.0, 0.0)
        self._send(ViewerCameraMessage((1.0, 0.0, 0.0, 0.0), position, 0.17, 0.01, 100.0, 720, width, look_at, up))


@pytest.fixture
def browser(tmp_path: Path, serve_recording: Path) -> Iterator[CameraOfBrowser]:
    workspace = Workspace(tmp_path)
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    lab = App(workspace, Library(workspace), "serve", host="127.0.0.1", port=0)
    browser = CameraOfBrowser(lab.port)
    session = browser.wait_session(lab, PATIENCE_S)
    session.send(ShowSpace(False))
    eventually(lambda: session.sheet.pictures, "the pictures")
    browser.wait_quiet(PATIENCE_S)
    yield browser
    browser.close()
    lab.stop()


def test_a_report_that_is_older_than_the_latest_move_does_not_keep_the_camera_away(browser: CameraOfBrowser) -> None:
    def put_after(report: Point, width: int) -> Point:
        before = len(browser.put)
        browser.report(report, width)
        eventually(lambda: len(browser.put) > before, "the camera to be moved")
        browser.wait_quiet(PATIENCE_S)
        return browser.put[-1]

    wide = put_after((1.0, 2.0, -30.0), 870)
    narrow = put_after(wide, 566)  # a panel opens at the left
    assert abs(narrow[2]) > 1.4 * abs(wide[2])
    # The panel closes, and the browser says so before it has heard of its camera's latest move.
    assert put_after(wide, 870) == pytest.approx(wide)
