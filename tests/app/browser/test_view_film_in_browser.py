"""Pictures and films of the 3D view, drawn by a real browser. Screenshots are kept under test-artifacts/."""

import math

import av
import numpy as np
import pytest
from PIL import Image

from app.export.exporter import ExportState
from app.modes.watch.commands import ShowSpace
from app.scene.ball import BALL_RGB, CORE_RGB
from app.scene.view_camera import ViewCamera
from app.state.commands import StopAt
from core.geometry import matrix_from_quaternion
from tests.app.browser.window import choose, open_page
from tests.waiting import eventually

SIZE = (960, 540)
AT_US = 300_000


def enter(window, title: str) -> None:
    """Export's 3D view of the moment."""
    window.press("Export")
    eventually(lambda: window.state.mode == "Export", "the mode")
    choose(window.page, "Format", title)
    choose(window.page, "Size", "960 x 540")
    eventually(lambda: window.session.world.visible, "the 3D view in Export")
    window.wait_until_camera_stands()


def place(eye: ViewCamera, p_world_m: np.ndarray, width: int, height: int) -> tuple[int, int]:
    """Column and row of a point in a picture of that size."""
    x, y, z = matrix_from_quaternion(eye.wxyz).T @ (p_world_m - eye.p_world_m)
    f = height / 2 / math.tan(eye.fov_rad / 2)
    return round(width / 2 + f * x / z), round(height / 2 + f * y / z)


def shows_ball(image: np.ndarray, eye: ViewCamera, ball: np.ndarray) -> bool:
    column, row = place(eye, ball, image.shape[1], image.shape[0])
    around = image[row - 6 : row + 7, column - 6 : column + 7].astype(int)
    return all((np.abs(around - rgb).max(axis=-1) < 70).any() for rgb in (CORE_RGB, BALL_RGB))


def colour_at(image: np.ndarray, column: int, row: int) -> np.ndarray:
    return np.median(image[row - 2 : row + 3, column - 2 : column + 3].reshape(-1, 3), axis=0)


@pytest.fixture
def followed(window, lab):
    """The recording in 3D, all of it followed, at a moment with a ball."""
    window.session.send(ShowSpace(True))
    rally = lab.services.rallies.of(window.session.recording)
    eventually(lambda: rally.followed == 1.0, "the chain to follow the recording")
    window.session.send(StopAt(AT_US))
    eventually(lambda: window.state.playhead.anchor_us == AT_US, "the moment")
    return rally


def a_picture_of_the_3d_view_has_the_ball_where_the_view_has_it(window, workspace, followed) -> None:
    enter(window, "Picture of the 3D view (.png)")
    eye, ball = window.session.world.eye, followed.picture_at(AT_US).ball
    camera = window.session.client.camera
    seen = (slice(0, camera.image_height), slice(0, camera.image_width))
    window.wait_for_pixels("export-view", lambda image: shows_ball(image, eye, ball), seen)
    window.page.locator("button", has_text="Export").last.click()
    path = workspace.exports / "serve-3d-1.png"
    eventually(path.is_file, "the picture")
    image = np.asarray(Image.open(path))
    assert image.shape == (540, 960, 3) and shows_ball(image, eye, ball)
    screen = window.screenshot("export-view")[seen]
    height, width = screen.shape[:2]
    for column, row in ((415, 390), (684, 270), (250, 120), (700, 30), (100, 60)):  # table, floor, background
        there = 480 + (column - width / 2) * 540 / height, 270 + (row - height / 2) * 540 / height
        both = [colour_at(screen, column, row), colour_at(image, *map(round, there))]
        assert np.abs(both[0] - both[1]).max() < 14, f"the picture is as what is seen at {column}, {row}: {both}"
    eventually(lambda: not window.session._modes["Export"]._shots.running, "the view to be let go")


def a_film_of_the_3d_view_shows_each_moment_and_the_cursor_stays(window, workspace, followed) -> None:
    enter(window, "Film of the 3D view (.mp4)")
    choose(window.page, "Film speed", "1/2")
    window.fill(window.field("From [s]"), "0.3")
    window.fill(window.field("To [s]"), "0.38")
    window.page.keyboard.press("Enter")
    plan = window.session._modes["Export"]._plan
    eventually(lambda: (plan.plan.start_us, plan.plan.end_us) == (300_000, 380_000), "the part")
    eye = window.session.world.eye
    window.page.locator("button", has_text="Export").last.click()
    path = workspace.exports / "serve-3d-1.mp4"
    eventually(path.is_file, "the film")
    with av.open(str(path)) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 4 and frames[0].shape == (540, 960, 3)
    balls = [followed.picture_at(t_us).ball for t_us in range(300_000, 380_000, 20_000)]
    assert all(shows_ball(frame, eye, ball) for frame, ball in zip(frames, balls, strict=True))
    assert not shows_ball(frames[-1], eye, balls[0]), "it has moved"
    assert window.state.playhead.position_us(0.0) == AT_US
    eventually(lambda: not window.session._modes["Export"]._shots.running, "the view to be let go")
    window.wait_for_pixels(
        "export-film", lambda image: shows_ball(image, eye, followed.picture_at(AT_US).ball), seen_of(window)
    )


def test_the_3d_view_becomes_a_picture_and_a_film(window, workspace, followed) -> None:
    a_picture_of_the_3d_view_has_the_ball_where_the_view_has_it(window, workspace, followed)
    a_film_of_the_3d_view_shows_each_moment_and_the_cursor_stays(window, workspace, followed)


def seen_of(window) -> tuple[slice, slice]:
    camera = window.session.client.camera
    return slice(0, camera.image_height), slice(0, camera.image_width)


def is_running(state: ExportState | None) -> bool:
    return state is not None and state.running and state.share > 0


def test_a_film_ends_with_its_browser_and_leaves_no_file(window, lab, workspace, followed, chromium) -> None:
    exporter, before = lab.services.exporter, set(workspace.exports.iterdir())
    page = open_page(chromium)
    other = type(window)(page, lab)
    other.session.send(ShowSpace(True))
    enter(other, "Film of the 3D view (.mp4)")
    choose(page, "Film speed", "1/32")
    page.locator("button", has_text="Export").last.click()
    eventually(lambda: is_running(exporter.state()), "the first picture")
    page.close()
    eventually(lambda: not exporter.state().running, "the film to end")
    assert exporter.state().failed and exporter.state().message == "the browser that draws the picture is gone"
    assert set(workspace.exports.iterdir()) == before
