"""The faults that a camera of a rig is given, and that the rest of the rig stays as it is."""

import numpy as np
import pytest

from benchmarks.perception.camera_faults import turned, without_half
from core.cameras.presets import camera_preset
from core.events import Events, SensorSize, Window


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_camera_sees_the_middle_of_its_picture_half_a_pixel_away(seed: int) -> None:
    cameras = camera_preset("corners")
    believed = turned(cameras, "far_left", 0.5, np.random.default_rng(seed))
    true = cameras["far_left"]
    ahead = true.position_world_m + 2.0 * true.T_world_camera[:3, 2]
    moved = believed["far_left"].project(ahead) - true.project(ahead)
    assert np.linalg.norm(moved) == pytest.approx(0.5, rel=0.01)
    assert np.array_equal(believed["far_left"].position_world_m, true.position_world_m)
    assert all(believed[name] is cameras[name] for name in cameras if name != "far_left")


def test_a_camera_blind_in_one_half_keeps_every_event_of_the_other() -> None:
    x = np.arange(8, dtype=np.uint16)
    events = Events.from_columns(np.arange(8), x, np.zeros(8, np.uint16), x > 3, SensorSize(8, 4))
    window = Window(events, 0, 1000)
    assert without_half(window, "left").events.x_px.tolist() == [4, 5, 6, 7]
    assert without_half(window, "right").events.x_px.tolist() == [0, 1, 2, 3]
    assert (without_half(window, "left").start_us, without_half(window, "left").end_us) == (0, 1000)
