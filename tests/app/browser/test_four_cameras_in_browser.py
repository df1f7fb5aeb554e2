"""Four and six cameras in Watch, Tune and Label, in a browser of 1280x720. Screenshots stay under test-artifacts/."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from app.server import App
from app.shared.library import Library
from app.shared.workspace import Workspace
from app.views.image_view import FOV_RAD, UNIT
from core.cameras.presets import camera_preset
from core.events import SensorSize
from core.geometry import look_at
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from labels.model import PositionSource
from tests.waiting import eventually

BALL_US = 300_000
FOUR = ("near_left", "near_right", "far_left", "far_right")
SIX = (*FOUR, "top_left", "top_right")
BOXES = """() => [...document.querySelectorAll("#root img")].filter(one => one.checkVisibility()).map(one => {
    const { x, y, width, height } = one.getBoundingClientRect();
    return [x, y, x + width, y + height]; })"""


@pytest.fixture
def window(tmp_path: Path, four_recording: Path, open_window) -> Iterator:
    shutil.copy(four_recording, Workspace(tmp_path).recording_path("four"))
    yield from watching(tmp_path, "four", open_window)


@pytest.fixture
def six_window(tmp_path: Path, open_window) -> Iterator:
    pair = {f"top_{side}": camera for side, camera in camera_preset("ceiling").items()}
    half = np.diag([0.5, 0.5, 1.0])
    cameras = {
        name: replace(camera, sensor=SensorSize(640, 360), K=half @ camera.K)
        for name, camera in {**camera_preset("corners"), **pair}.items()
    }
    config = StereoConfig(sensor=SensorConfig(noise_hz=0.1))
    simulate_recording(Workspace(tmp_path).recording_path("six"), config, cameras, [LaunchConfig()], seed=4)
    yield from watching(tmp_path, "six", open_window)


def watching(folder: Path, name: str, open_window) -> Iterator:
    """A window that shows the ball of a recording of the workspace in 3D."""
    workspace = Workspace(folder)
    lab = App(workspace, Library(workspace), name, host="127.0.0.1", port=0)
    with open_window(lab, in_space=True) as window:
        eventually(lambda: window.session.world.visible, "the 3D scene")
        rally = lab.services.rallies.of(window.session.recording)
        eventually(lambda: rally.followed == 1.0, "the chain to have seen it")
        window.seek(BALL_US)
        yield window
    lab.stop()


def on_sheet(window, x: float, y: float) -> tuple[float, float]:
    """CSS pixels of a point of the sheet."""
    box, camera = window.page.locator("canvas").first.bounding_box(), window.session.client.camera
    scale = box["height"] / (2 * abs(camera.position[2]) * math.tan(FOV_RAD / 2))
    return (
        box["x"] + box["width"] / 2 + (x * UNIT - camera.look_at[0]) * scale,
        box["y"] + box["height"] / 2 + (y * UNIT - camera.look_at[1]) * scale,
    )


def overlap(one: list[float], other: list[float]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def watch_shows_all_pictures_with_marks_above_the_figures(window, names: tuple[str, ...]) -> None:
    page = window.page
    eventually(lambda: len(page.evaluate(BOXES)) == len(names), "all pictures")
    for name in names:
        page.get_by_text(f"● {name}", exact=True).wait_for()
    figures = ("Ball speed", "Stereo mismatch", "Placed by")
    # A table that is written anew has no place for a moment.
    found = [eventually(page.get_by_text(name, exact=True).bounding_box, name) for name in figures]
    canvas = page.locator("canvas").first.bounding_box()
    boxes = page.evaluate(BOXES)
    assert not any(overlap(one, other) for one, other in combinations(boxes, 2))
    assert all(right <= canvas["x"] for _, _, right, _ in boxes), "beside the scene"
    assert all(box["y"] > max(bottom for *_, bottom in boxes) and box["y"] + box["height"] <= 720 for box in found)
    page.get_by_text(f"{len(names)} of {len(names)} cameras").wait_for()
    window.screenshot(f"{len(names)}-cameras-watch")


def every_camera_stands_in_the_view(window) -> None:
    window.wait_until_camera_stands()
    eye = window.session.client.camera
    places = np.array([stream.calibration.position_world_m for stream in window.session.recording.cameras.values()])
    T = look_at(eye.position, eye.look_at)
    seen = (places - T[:3, 3]) @ T[:3, :3]
    half = math.tan(eye.fov / 2)
    assert (np.abs(seen[:, :2] / seen[:, 2:]) < [half * eye.aspect, half]).all()


def one_picture_is_large_and_the_scene_comes_back(window) -> None:
    window.choose("Larger", "far_left")
    eventually(lambda: window.state.watch.large == "far_left", "the camera in the middle")
    eventually(lambda: len(window.session.sheet.pictures) == 1, "one picture")
    window.choose("Larger", "3D")
    eventually(lambda: window.session.world.visible, "the scene again")
    window.page.locator("#root img:visible").nth(3).dblclick()
    eventually(lambda: window.state.watch.large == "far_right", "the camera that was clicked twice")
    window.choose("Larger", "3D")
    eventually(lambda: window.session.world.visible, "the scene again")


def tune_shows_the_camera_that_is_chosen(window) -> None:
    window.press("Tune")
    eventually(lambda: window.state.mode == "Tune", "Tune")
    window.choose("Camera", "far_right")
    eventually(lambda: window.state.camera == "far_right", "the camera")
    eventually(lambda: any("far_right" in text.text for text in window.session.sheet.texts), "its picture")
    window.page.get_by_text("ball at").first.wait_for()
    window.screenshot("four-tune")


def pictures_of_label_stand_apart(window, cameras: int) -> None:
    """The large picture, the strip, the whole picture and the other cameras."""
    boxes = [(tile.x, tile.y, tile.x + tile.width, tile.y + tile.height) for tile in window.session.sheet.pictures]
    assert len(boxes) == cameras + 2 and not any(overlap(one, other) for one, other in combinations(boxes, 2))
    bar = window.page.locator("#rallyscope-bar").bounding_box()
    for _, _, right, bottom in boxes:
        x, y = on_sheet(window, right, bottom)
        assert x <= bar["x"] + bar["width"] and y <= bar["y"], "nothing is cut off"


def label_accepts_in_all_what_two_have(window) -> None:
    page = window.page
    window.press("Label")
    mode = window.session._modes["Label"]
    eventually(lambda: mode._editor is not None and window.stands_in_label(), "Label")
    window.session.later(lambda: mode._use_name("anna"))
    eventually(lambda: mode._editor.labelling.view.annotator == "anna", "the name")
    work = lambda: mode._editor.labelling  # noqa: E731

    def shows(camera: str) -> bool:
        return work().view.camera == camera and work().on_screen and not mode._pictures.busy

    def click_truth(camera: str) -> None:
        eventually(lambda: shows(camera), f"the picture of {camera}")
        truth, main = work().source.stream.truth.at(BALL_US), mode._pictures.shown.main
        u, v = float(truth.u_px[0]), float(truth.v_px[0])
        x = main.x + (u + 0.5 - main.region.x) / main.region.width * main.width
        y = main.y + (v + 0.5 - main.region.y) / main.region.height * main.height
        window.click_picture(*map(round, on_sheet(window, x, y)))
        eventually(lambda: BALL_US in work().here.labels, f"the label in {camera}")

    first = work().view.camera
    click_truth(first)
    tiles = dict(mode._pictures.shown.others)
    second = next(iter(tiles))
    tile = tiles[second]
    window.click_picture(*map(round, on_sheet(window, tile.x + tile.width / 2, tile.y + tile.height / 2)))
    click_truth(second)
    page.keyboard.press("8")  # ten times as large: all pictures follow the ball
    eventually(lambda: shows(second) and work().view.zoom > 1, "the ball, large")
    page.get_by_text("2 of 2 cameras agree").first.wait_for()
    window.wait_until_still()
    pictures_of_label_stand_apart(window, cameras=4)
    window.screenshot("four-label")
    page.keyboard.press("Shift+U")
    eventually(lambda: all(BALL_US in known.labels for known in work().works.values()), "labels in all cameras")
    assert work().works[first].labels[BALL_US].provenance.source is PositionSource.SNAPPED
    for name in set(FOUR) - {first, second}:
        label, truth = work().works[name].labels[BALL_US], window.session.recording.cameras[name].truth.at(BALL_US)
        assert math.dist((label.x_px, label.y_px), (truth.u_px[0], truth.v_px[0])) < 1.0
        assert label.provenance.source is PositionSource.ACCEPTED
    eventually(lambda: work().t_us == BALL_US + work().step_us, "the next time")
    window.seek(BALL_US)
    page.get_by_text("4 of 4 cameras agree").first.wait_for()
    page.get_by_text("px of each:").first.wait_for()
    window.screenshot("four-labelled")


def test_four_cameras_are_watched_tuned_and_labelled(window) -> None:
    watch_shows_all_pictures_with_marks_above_the_figures(window, FOUR)
    every_camera_stands_in_the_view(window)
    one_picture_is_large_and_the_scene_comes_back(window)
    tune_shows_the_camera_that_is_chosen(window)
    label_accepts_in_all_what_two_have(window)


def test_six_cameras_are_watched_and_labelled_and_nothing_overlaps(six_window) -> None:
    window = six_window
    watch_shows_all_pictures_with_marks_above_the_figures(window, SIX)
    every_camera_stands_in_the_view(window)
    window.press("Label")
    mode = window.session._modes["Label"]
    eventually(lambda: mode._editor is not None and window.stands_in_label(), "Label")
    shown = lambda: mode._editor.labelling.on_screen and mode._pictures.shown  # noqa: E731
    assert len(eventually(shown, "the pictures").others) == 5
    window.wait_until_still()
    pictures_of_label_stand_apart(window, cameras=6)
    window.screenshot("six-cameras-label")
