"""Rooms to train on, each drawn and rendered by the cameras that recordings have."""

import numpy as np
import pytest

from benchmarks.detector_training import pool as pools
from benchmarks.detector_training.pool import (
    LabelledPictures,
    data_set_pool,
    draw_camera,
    draw_scene,
    render_room,
    rendered_pool,
)
from core.detection.yolo.config import DetectorTrainingConfig, YoloConfig
from core.errors import ConfigError, RecordingError
from core.events import Events, SensorSize
from core.recordings import PixelTruth, RecordingWriter

CONFIG = DetectorTrainingConfig(rooms=3, frames_per_room=8, yolo=YoloConfig(input_width_px=640, input_height_px=384))


@pytest.fixture(scope="module")
def room() -> LabelledPictures:
    return render_room(CONFIG, 4)


def test_a_room_has_pictures_of_the_inputs_scale_and_most_have_a_ball_where_they_say(room) -> None:
    assert room.images.shape == (8, 360, 640, 3) and room.images.dtype == np.uint8
    there = np.isfinite(room.circles).all(axis=1)
    assert there.sum() >= 5
    still = np.median(room.images, axis=0)
    for image, (x, y, r) in zip(room.images[there], room.circles[there], strict=True):
        assert 1.5 < r < 20
        change = np.abs(image.astype(np.float64) - still).sum(axis=2)
        near = change[max(0, int(y - r)) : int(y + r) + 1, max(0, int(x - r)) : int(x + r) + 1]
        assert near.mean() > 3 * change.mean()


def test_the_same_room_is_the_same_and_another_number_or_seed_another(room) -> None:
    again = render_room(CONFIG, 4)
    assert np.array_equal(again.images, room.images) and np.array_equal(again.circles, room.circles, equal_nan=True)


def test_rooms_differ_in_colours_people_and_cameras() -> None:
    scenes = [draw_scene(np.random.default_rng([0, number])) for number in range(60)]
    assert {one.cast for one in scenes} == {"nobody", "person", "two-persons", "rally", "head"}
    assert np.ptp([one.wall for one in scenes]) > 0.4 and np.ptp([one.ball for one in scenes]) > 0.4
    cameras = [draw_camera(np.random.default_rng([1, number])) for number in range(30)]
    assert np.ptp([one.K[0, 0] for one in cameras]) > 200
    assert {one.position_world_m[1] > 0 for one in cameras} == {True, False}


def test_rendered_rooms_are_kept_and_only_the_missing_ones_are_rendered(room, tmp_path, monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(pools, "render_room", lambda config, number: asked.append(number) or room)
    first = rendered_pool(tmp_path, CONFIG, cancelled=lambda: len(asked) == 2)
    assert asked == [0, 1] and len(first) == 16
    whole = rendered_pool(tmp_path, CONFIG)
    assert asked == [0, 1, 2] and len(whole) == 24
    assert np.array_equal(whole.groups[2].images, room.images)
    assert whole.rows().shape == (24, 2) and len(whole.part(1, 3)) == 16


def test_the_pictures_of_another_training_are_not_taken(tmp_path, room, monkeypatch) -> None:
    monkeypatch.setattr(pools, "render_room", lambda config, number: room)
    rendered_pool(tmp_path, CONFIG)
    other = DetectorTrainingConfig(rooms=3, frames_per_room=8, seed=1)
    with pytest.raises(ConfigError, match="another training"):
        rendered_pool(tmp_path, other)


def test_a_data_set_gives_its_pictures_and_where_the_ball_is(tmp_path) -> None:
    images = np.random.default_rng(0).integers(0, 255, (3, 72, 128, 3), np.uint8)
    t_us, seen = np.array([1000, 2000, 3000]), np.array([True, True, False])
    u = np.array([10.0, 30.0, np.nan])
    with RecordingWriter(tmp_path / "one.h5", {"left": SensorSize(128, 72), "right": SensorSize(128, 72)}) as writer:
        writer.append("left", Events.from_columns([5], [3], [4], [True], SensorSize(128, 72)))
        writer.write_frames("left", t_us, np.full(3, 500), images)
        writer.write_truth("left", PixelTruth(t_us, u, u, u / 5, seen))
        writer.extend_duration(4000)
    small = DetectorTrainingConfig(yolo=YoloConfig(input_width_px=64, input_height_px=64))
    (group,) = data_set_pool(tmp_path, small).groups
    assert group.images.shape == (3, 36, 64, 3)
    np.testing.assert_allclose(group.circles[:2], [[5.25, 5.25, 1.0], [15.25, 15.25, 3.0]])
    assert np.isnan(group.circles[2]).all()


def test_a_folder_without_pictures_is_one_clear_line(tmp_path) -> None:
    with pytest.raises(RecordingError, match=r"no pictures to train on.*rallyscope simulate"):
        data_set_pool(tmp_path, CONFIG)
