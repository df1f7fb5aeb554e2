"""Event cameras as the live source, in headless Chromium: how they do, their biases, and one that is unplugged."""

from collections.abc import Iterator

import pytest

from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from core.devices.models import read_biases
from core.devices.neuromorphic import open_camera
from core.events import Events
from core.live.camera_source import CameraSource
from core.recordings import open_recording
from tests.core.devices.replayed_hardware import Replayed, ReplayedLibrary
from tests.waiting import eventually

ROUND_US = 600_000


class Again:
    """What a camera of a recording saw, again and again."""

    def __init__(self, stream) -> None:
        self.sensor, self._seen = stream.sensor, stream.slice(0, ROUND_US)

    def slice(self, start_us: int, end_us: int) -> Events:
        later_us = start_us // ROUND_US * ROUND_US
        seen = self._seen.between(start_us - later_us, end_us - later_us)
        return Events.from_columns(seen.t_us + later_us, seen.x_px, seen.y_px, seen.on, seen.sensor)


@pytest.fixture
def library(serve_recording) -> Iterator[ReplayedLibrary]:
    with open_recording(serve_recording) as recording:
        yield ReplayedLibrary(
            {
                str(k): Replayed(stream=Again(stream), duration_us=10**10)
                for k, stream in enumerate(recording.cameras.values())
            }
        )


@pytest.fixture
def camera_lab(tmp_path, library, serve_recording) -> Iterator[App]:
    with open_recording(serve_recording) as recording:
        calibration = {name: stream.calibration for name, stream in recording.cameras.items()}
    devices = {name: open_camera(str(k), driver=library) for k, name in enumerate(calibration)}
    workspace = Workspace(tmp_path)
    live = LiveRally(CameraSource(devices, calibration=calibration, cable=True))
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    yield lab
    lab.stop()


def test_cameras_are_watched_their_biases_are_set_and_one_that_is_unplugged_is_said(
    chromium, camera_lab, library, open_window
) -> None:
    rally = camera_lab.services.rallies.live
    assert rally is not None
    with open_window(camera_lab, in_space=True) as window:
        page = window.page
        eventually(lambda: rally.history.predicted_hits(), "the ball to be seen and predicted")
        page.get_by_text("live from Prophesee EVK4 0 and Prophesee EVK4 1").wait_for()
        page.get_by_text("ppm against this machine").first.wait_for()
        page.get_by_text("one with left's, by cable").wait_for()
        window.screenshot("cameras-status")
        page.get_by_text("Biases of left", exact=True).click()
        page.get_by_text("diff_on", exact=True).first.wait_for()
        device = library.opened[0]
        slider = page.get_by_role("slider").first
        slider.focus()
        for _ in range(3):
            page.keyboard.press("ArrowRight")
        eventually(lambda: device.configuration.biases.diff_on == 3, "the camera to be told")
        page.get_by_role("button", name="Save biases").first.click()
        path = camera_lab.services.workspace.biases_path
        eventually(path.exists, "the biases to be saved")
        assert read_biases(path)["Prophesee EVK4 0"]["diff_on"] == 3
        window.screenshot("cameras-watch")
        library.opened[1].unplugged = True
        page.get_by_text("the device was disconnected").wait_for()
        page.get_by_text("Camera right is lost").or_(page.get_by_text("lost, no data for")).first.wait_for()
        since_us = rally.history.followed_us
        eventually(lambda: rally.history.followed_us > since_us + 200_000, "the other camera to be followed")
        window.screenshot("cameras-lost")
