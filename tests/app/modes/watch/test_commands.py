"""One camera's picture fills the middle, and the scene comes back."""

from dataclasses import replace

import pytest

from app.modes.watch.commands import EnlargeCamera, EnlargeNextCamera, EnlargePicture, ShowSpace
from app.state.client_state import ClientState, Configs, History, Playhead
from core.detection import DetectorConfig


@pytest.fixture
def state() -> ClientState:
    configs = History(Configs(DetectorConfig(), DetectorConfig()))
    return ClientState("demo", ("left", "right"), "left", Playhead(1_000_000), configs)


def test_a_camera_is_enlarged_and_the_same_again_gives_the_scene_back(state) -> None:
    large = EnlargeCamera("right").apply(state, 0.0)
    assert large.watch.large == "right"
    assert EnlargeCamera("left").apply(large, 0.0).watch.large == "left"
    assert EnlargeCamera("right").apply(large, 0.0) == state
    assert ShowSpace(True).apply(large, 0.0) == state


def test_the_next_camera_and_then_the_scene_again(state) -> None:
    seen = []
    for _ in range(3):
        state = EnlargeNextCamera().apply(state, 0.0)
        seen.append(state.watch.large)
    assert seen == ["left", "right", ""]


def test_a_frame_camera_is_enlarged_as_event_cameras_are_and_comes_behind_them(state) -> None:
    with_frames = replace(state, frame_cameras=("rgb",))
    large = EnlargeCamera("rgb").apply(with_frames, 0.0)
    assert large.watch.large == EnlargePicture("\u25cf rgb").apply(with_frames, 0.0).watch.large == "rgb"
    assert EnlargeNextCamera().apply(EnlargeCamera("right").apply(with_frames, 0.0), 0.0) == large
    assert EnlargeNextCamera().apply(large, 0.0) == with_frames
    assert EnlargeCamera("rgb").apply(state, 0.0) == state, "one that is not followed has no picture"


def test_an_unknown_camera_and_another_mode_change_nothing(state) -> None:
    assert EnlargeCamera("../x").apply(state, 0.0) == state
    label = replace(state, mode="Label")
    assert EnlargeNextCamera().apply(label, 0.0) == label


def test_a_double_click_enlarges_a_camera_and_one_anywhere_else_gives_the_scene_back(state) -> None:
    large = EnlargePicture("right").apply(state, 0.0)
    assert large.watch.large == "right"
    assert EnlargePicture("left").apply(large, 0.0).watch.large == "left"
    assert EnlargePicture("right").apply(large, 0.0) == EnlargePicture("").apply(large, 0.0) == state
    assert EnlargePicture("").apply(state, 0.0) == state


def test_a_mark_before_the_name_in_a_caption_is_no_part_of_it(state) -> None:
    assert EnlargePicture("● right").apply(state, 0.0).watch.large == "right"
    assert EnlargePicture("● nobody").apply(state, 0.0) == EnlargePicture("● ").apply(state, 0.0) == state
    spaced = replace(state, cameras=("a b", "b"))
    assert EnlargePicture("a b").apply(spaced, 0.0).watch.large == "a b"


@pytest.mark.parametrize("said", ["../x", None, 3, ["left"], {"left": 1}])
def test_what_a_page_says_that_is_no_camera_changes_nothing(state, said: object) -> None:
    large = EnlargeCamera("left").apply(state, 0.0)
    assert EnlargePicture(said).apply(large, 0.0) == large


def test_a_double_click_in_another_mode_changes_nothing(state) -> None:
    label = replace(EnlargeCamera("left").apply(state, 0.0), mode="Label")
    assert EnlargePicture("").apply(label, 0.0) == label == EnlargePicture("right").apply(label, 0.0)
