"""How long a metre is, where nothing else is calibrated beside it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.calibration.bench_rig import click_corners
from core.cameras import stereo_preset
from core.cameras.calibration.bundle import Rig
from core.cameras.calibration.scale import Scale, body_scale, measure_scale
from core.errors import CalibrationError
from core.geometry import make_transform

pytestmark = pytest.mark.numeric
HALF = 0.5
"""Metres in a unit of the rig are twice as many."""
RIG = Rig(
    tuple(
        replace(camera, T_world_camera=make_transform(camera.T_world_camera[:3, :3], HALF * camera.position_world_m))
        for camera in stereo_preset("side").values()
    ),
    np.zeros(2),
    np.zeros(2),
)
NOTHING = np.empty((0, 2, 2))


def test_a_wand_of_known_length_is_a_body_of_two_markers_and_gives_metres() -> None:
    body_m = Scale("wand", 0.4).body_m
    assert np.linalg.norm(body_m[1] - body_m[0]) == 0.4 and Scale("gravity").body_m.tolist() == [[0, 0, 0]]
    found = body_scale(body_m, 20)
    assert (found.metres_per_unit, found.origin) == (1.0, "the wand at 20 times")
    assert body_scale(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]), 3).origin == "the board at 3 times"


def test_a_single_point_is_no_wand() -> None:
    with pytest.raises(CalibrationError, match="a single point"):
        measure_scale(Scale("wand", 0.4), np.zeros(0), RIG, NOTHING, 0.3, {})


def test_a_given_baseline_is_the_scale_of_a_rig_whose_cameras_are_one_apart() -> None:
    found = measure_scale(Scale("baseline", 3.5), np.zeros(0), RIG, NOTHING, 0.3, {})
    assert (found.metres_per_unit, found.sigma_relative, found.up) == (3.5, 0.0, None)


def test_the_corners_in_two_pictures_give_the_metres_of_a_unit() -> None:
    clicks = click_corners(stereo_preset("side"), np.random.default_rng(0), 0.0)
    found = measure_scale(Scale("table"), np.zeros(0), RIG, NOTHING, 0.3, dict(enumerate(clicks.values())))
    assert found.metres_per_unit == pytest.approx(1 / HALF, rel=1e-6)


@pytest.mark.parametrize(("length_m", "fine"), [(1e-3, True), (0.9e-3, False), (100.0, True), (100.1, False)])
@pytest.mark.parametrize("kind", ["wand", "baseline"])
def test_lengths_from_a_millimetre_to_a_hundred_metres_are_possible(kind, length_m: float, fine: bool) -> None:
    if fine:
        assert Scale(kind, length_m).length_m == length_m
    else:
        with pytest.raises(CalibrationError, match=f"impossible {kind}"):
            Scale(kind, length_m)
