"""What a person sees of the 3D view, in pixels: the ball first of all, a table with legs, a middle that is no slit."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.modes.watch.commands import EnlargeNextCamera, ShowLayer
from app.scene.painted import BALL_CORE_RGB, BALL_RING_RGB
from app.scene.view_camera import MIN_SHARE, ViewCamera, view_camera_of
from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.state.commands import Seek
from core.geometry import matrix_from_quaternion
from core.history.played_bodies import PlayedBodies
from tests.waiting import eventually

BALL_US = 420_000
CONTRAST = 4.0
"""Of the ball's core to all that is round it, as web pages count it; text is to have 4.5, large text 3."""
LEG_CONTRAST = 2.0
SIZES = [(1280, 720), (1600, 900), (1920, 1080), (1000, 700)]


@pytest.fixture(scope="module")
def scene_lab(tmp_path_factory: pytest.TempPathFactory, serve_recording: Path) -> Iterator[App]:
    workspace = Workspace(tmp_path_factory.mktemp("scene"))
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    lab = App(workspace, Library(workspace), "serve", host="127.0.0.1", port=0)
    yield lab
    lab.stop()


@pytest.fixture
def space(scene_lab, open_window):
    with open_window(scene_lab, in_space=True) as window:
        eventually(lambda: window.session.world.visible, "the 3D scene")
        rally = scene_lab.services.rallies.of(window.session.recording)
        eventually(lambda: rally.followed == 1.0, "the chain to have seen it")
        window.session.send(Seek(BALL_US))
        window.rally = rally
        yield window


def luminance(rgb: np.ndarray) -> np.ndarray:
    share = rgb / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def contrast(first: float, second: float) -> float:
    low, high = sorted((first, second))
    return (high + 0.05) / (low + 0.05)


def canvas_of(window) -> tuple[int, int, int, int]:
    """Left, top, width and height of the 3D view."""
    box = window.page.locator("canvas").first.bounding_box()
    return round(box["x"]), round(box["y"]), round(box["width"]), round(box["height"])


def pixel_of(window, p_world_m: np.ndarray) -> tuple[float, float]:
    """Column and row in the window of a point (3,), by the pinhole that the browser reports."""
    eye: ViewCamera = view_camera_of(window.session.client)
    left, top, width, height = canvas_of(window)
    x, y, z = matrix_from_quaternion(eye.wxyz).T @ (p_world_m - eye.p_world_m)
    f = height / 2 / np.tan(eye.fov_rad / 2)
    return left + width / 2 + f * x / z, top + height / 2 + f * y / z


def is_like(image: np.ndarray, rgb: tuple[int, int, int], tolerance: int = 14) -> np.ndarray:
    return np.abs(image.astype(int) - rgb).max(axis=-1) < tolerance


def the_ball_is_the_brightest_thing_just_where_it_is(space, size) -> None:
    space.page.set_viewport_size({"width": size[0], "height": size[1]})
    eventually(lambda: canvas_of(space)[2] >= 0.45 * size[0], "the middle to be no slit: the panels make room")
    space.wait_until_camera_stands()
    _, _, width, height = canvas_of(space)
    assert width >= 0.45 * size[0], "the middle is no slit"
    ball = space.rally.history.at(BALL_US, {}).picture.ball
    radius = MIN_SHARE * height

    def around_ball(window: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is round the ball, and where its first pixel is: panels may have changed their widths once more."""
        u, v = pixel_of(space, ball)
        rows, columns = (slice(round(at - 8 * radius), round(at + 8 * radius)) for at in (v, u))
        return window[rows, columns], np.array([rows.start, columns.start])

    def centre(seen: np.ndarray) -> np.ndarray:
        return np.argwhere(is_like(seen, BALL_CORE_RGB)).mean(axis=0)

    def is_there(window: np.ndarray) -> bool:  # the picture of the time just sought, drawn in the new shape
        seen, corner = around_ball(window)
        where = np.array(pixel_of(space, ball)[::-1])
        return is_like(seen, BALL_CORE_RGB).sum() > 20 and np.abs(centre(seen) + corner - where).max() < 2.0

    image, _ = around_ball(space.wait_for_pixels(f"scene-{size[0]}", is_there, (slice(None), slice(None))))
    found = centre(image)
    assert is_like(image, BALL_RING_RGB, 40).sum() > 20, "with its orange ring"
    away = np.hypot(*(np.indices(image.shape[:2]) - found[:, None, None]))
    light = luminance(image)
    core = float(np.median(light[away < 0.6 * radius]))
    round_it = light[(away > 2.0 * radius) & (away < 5 * radius)]
    assert contrast(core, float(np.median(round_it))) > CONTRAST
    assert core > float(np.quantile(round_it, 0.99))


def legs_stand_out_from_the_ground(space) -> None:
    space.page.set_viewport_size({"width": 1280, "height": 720})
    space.wait_until_camera_stands()

    def leg_stands_out(image: np.ndarray, x: float, y: float) -> bool:
        u, v = (round(value) for value in pixel_of(space, np.array([x, y, -0.5])))
        leg = float(np.median(luminance(image[v - 3 : v + 4, u - 1 : u + 2])))
        beside = luminance(
            np.concatenate([image[v - 3 : v + 4, u - 30 : u - 20], image[v - 3 : v + 4, u + 20 : u + 30]])
        )
        return contrast(leg, float(np.median(beside))) > LEG_CONTRAST

    def both_do(image: np.ndarray) -> bool:
        return all(leg_stands_out(image, x, y) for x, y in ((-1.1, -0.62), (1.1, -0.62)))

    image = space.wait_for_pixels("scene-legs", both_do, (slice(None), slice(None)))
    floor = luminance(image[-120:-90, 330:860])  # above the time bar
    assert floor.mean() > 0.08, "the ground is not black"


def persons_are_drawn_where_the_simulation_has_them(space) -> None:
    space.rally.following.bodies = PlayedBodies().then(0, "person", 3)
    space.session.send(Seek(BALL_US + 1_000))
    eventually(lambda: space.session.world._people._handles is not None, "the person")
    space.wait_until_camera_stands()
    people = space.rally.following.bodies.at(BALL_US + 1_000)
    u, v = (round(value) for value in pixel_of(space, people.ends_m[2].mean(axis=0)))  # the trunk
    patch = (slice(v - 2, v + 3), slice(u - 2, u + 3))

    def is_a_person(seen: np.ndarray) -> bool:
        """Grey, and lighter than what is behind."""
        return bool(np.ptp(seen.astype(int), axis=-1).max() < 40 and seen.mean() > 110)

    space.wait_for_pixels("scene-person", is_a_person, patch)
    space.session.send(ShowLayer("People", False))
    space.wait_for_pixels("scene-no-person", lambda seen: not is_a_person(seen), patch)


def one_picture_fills_the_middle_and_the_scene_comes_back(space) -> None:
    space.page.get_by_role("button", name="left", exact=True).click()
    eventually(lambda: space.state.watch.large == "left", "the left camera in the middle")
    eventually(lambda: len(space.session.sheet.pictures) == 1, "one picture")
    assert not space.session.world.visible
    space.screenshot("scene-large")
    space.session.send(EnlargeNextCamera())
    eventually(lambda: space.state.watch.large == "right", "the other one")
    space.session.send(EnlargeNextCamera())
    eventually(lambda: space.session.world.visible, "the scene again")


def a_double_click_makes_a_picture_large_and_another_one_gives_the_scene_back(space) -> None:
    beside = space.page.locator("#root img:visible")
    for number, camera in enumerate(("left", "right")):
        eventually(lambda: beside.count() == 2, "both cameras' pictures beside the scene")
        beside.nth(number).dblclick()
        eventually(lambda camera=camera: space.state.watch.large == camera, f"the {camera} camera in the middle")
        eventually(lambda: len(space.session.sheet.pictures) == 1, "one picture")
        left, top, width, height = canvas_of(space)
        space.page.mouse.dblclick(left + width / 2, top + height / 3)
        eventually(lambda: space.state.watch.large == "" and space.session.world.visible, "the scene again")


def a_view_that_a_person_turned_stays_when_the_window_changes(space) -> None:
    space.wait_until_camera_stands()
    left, top, width, height = canvas_of(space)
    space.page.mouse.move(left + width / 2, top + height / 2)
    space.page.mouse.down()
    space.page.mouse.move(left + width / 2 + 120, top + height / 2 + 10, steps=6)
    space.page.mouse.up()
    space.wait_until_camera_stands()
    turned = space.session.client.camera.position.copy()
    space.page.set_viewport_size({"width": 1500, "height": 720})
    eventually(lambda: canvas_of(space)[2] > width + 100, "a wider middle")
    space.wait_until_camera_stands()
    np.testing.assert_allclose(space.session.client.camera.position, turned, atol=0.05)


def test_ball_legs_and_persons_are_seen_in_the_3d_view(space) -> None:
    for size in SIZES:
        the_ball_is_the_brightest_thing_just_where_it_is(space, size)
    legs_stand_out_from_the_ground(space)
    persons_are_drawn_where_the_simulation_has_them(space)


def test_the_middle_is_given_to_a_picture_and_back_and_the_view_is_turned(space) -> None:
    one_picture_fills_the_middle_and_the_scene_comes_back(space)
    a_double_click_makes_a_picture_large_and_another_one_gives_the_scene_back(space)
    a_view_that_a_person_turned_stays_when_the_window_changes(space)
