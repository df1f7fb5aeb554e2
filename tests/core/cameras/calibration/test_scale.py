"""How long a metre is, where nothing else is calibrated beside it."""

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.cameras.calibration.bundle import Adjusted, Rig, Sightings
from core.cameras.calibration.scale import Scale, ScaleFound, measure_scale
from core.errors import CalibrationError

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset("side")
FOCALS = np.array([1000.0, 1000.0])
HALF = 0.5
"""Metres in a unit of the rig are twice as many."""
RIG = Rig(
    np.stack([camera.T_world_camera[:3, :3] for camera in CAMERAS.values()]),
    HALF * np.stack([camera.position_world_m for camera in CAMERAS.values()]),
    np.zeros(2),
)


def wand(t_us: np.ndarray, marker: np.ndarray, length_m: float, wobble_m: float) -> np.ndarray:
    """Pinhole coordinates (N, 2, 2) of marker 0 or 1 of a wand that turns; its length seems to wobble."""
    angle = t_us * 1e-5
    half = 0.5 * (length_m + wobble_m * np.where((t_us // 1000) % 2, 1, -1))
    along = np.column_stack([np.cos(angle), np.sin(angle), 0.3 * np.cos(angle)])
    along *= (half / np.linalg.norm(along, axis=1))[:, None]
    ps = np.array([-0.5, 0.0, 0.3]) + np.where(marker == 0, -1.0, 1.0)[:, None] * along
    local = [camera.to_camera(ps) for camera in CAMERAS.values()]
    return np.stack([p[:, :2] / p[:, 2:] for p in local], axis=1)


def measured(count: int, *, length_m: float = 0.4, wobble_m: float = 0.0, missing: int = 0) -> ScaleFound:
    t_us = np.tile(1000 * np.arange(count + 10), 2)
    marker = np.repeat([0, 1], count + 10)
    used = np.ones(len(t_us), bool)
    used[:10] = False  # the first ten are outliers: 10 cm too long there

    def at_marker(at_us: np.ndarray, which: np.ndarray) -> Sightings:
        assert at_us.tolist() == (1000 * np.arange(10, count + 10)).tolist()
        xys = wand(at_us, which, length_m, wobble_m)
        if which[0] == 1:
            xys[:missing] = np.nan
        return Sightings(at_us, lambda offsets_us, lead_px: xys, FOCALS)

    sightings = Sightings(t_us, lambda offsets_us, lead_px: wand(t_us, marker, length_m, 0.1), FOCALS)
    adjusted = Adjusted(RIG, np.zeros((15, 15)), 0.3, used)
    return measure_scale(Scale("wand", length_m), sightings, marker, adjusted, {}, at_marker)


def test_a_wand_of_known_length_gives_the_metres_of_a_unit() -> None:
    found = measured(40)
    assert found.kind == "wand" and found.metres_per_unit == pytest.approx(1 / HALF, rel=1e-9)
    assert found.sigma_relative == pytest.approx(0.0, abs=1e-9)
    assert measured(40, length_m=1.1).metres_per_unit == pytest.approx(1 / HALF, rel=1e-9)


def test_the_scatter_of_its_length_is_how_well_the_scale_is_known() -> None:
    # Half of the lengths are 4 mm too long and half too short: the median absolute deviation is 4 mm of 400.
    found = measured(100, wobble_m=0.004)
    assert found.sigma_relative == pytest.approx(1.4826 * 0.01 / np.sqrt(100), rel=1e-3)
    assert found.metres_per_unit == pytest.approx(1 / HALF, rel=0.01)


def test_twenty_common_times_of_both_ends_are_enough_and_fewer_are_not() -> None:
    assert measured(30, missing=10).origin == "the wand at 20 times"
    with pytest.raises(CalibrationError, match="too little of the wand") as caught:
        measured(30, missing=11)
    assert "19" in str(caught.value)


def test_a_given_baseline_is_the_scale_of_a_rig_whose_cameras_are_one_apart() -> None:
    sightings = Sightings(np.zeros(0), lambda offsets_us, lead_px: np.empty((0, 2, 2)), FOCALS)
    adjusted = Adjusted(RIG, np.zeros((15, 15)), 0.3, np.zeros(0, bool))
    found = measure_scale(
        Scale("baseline", 3.5), sightings, np.zeros(0, np.int64), adjusted, {}, lambda t_us, marker: sightings
    )
    assert (found.metres_per_unit, found.sigma_relative, found.up) == (3.5, 0.0, None)


@pytest.mark.parametrize(("length_m", "fine"), [(1e-3, True), (0.9e-3, False), (100.0, True), (100.1, False)])
@pytest.mark.parametrize("kind", ["wand", "baseline"])
def test_lengths_from_a_millimetre_to_a_hundred_metres_are_possible(kind, length_m: float, fine: bool) -> None:
    if fine:
        assert Scale(kind, length_m).length_m == length_m
    else:
        with pytest.raises(CalibrationError, match=f"impossible {kind}"):
            Scale(kind, length_m)
