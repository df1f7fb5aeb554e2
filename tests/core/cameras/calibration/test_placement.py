import numpy as np
import pytest

from core.cameras.calibration.bundle import Adjusted, Rig
from core.cameras.calibration.placement import place_upright
from core.cameras.calibration.scale import Scale, ScaleFound
from core.errors import CalibrationError
from core.geometry import look_at

pytestmark = pytest.mark.numeric


def adjusted() -> Adjusted:
    """The second camera 1 to the right of the first, its position uncertain by 0.01 along x of the first."""
    rig = Rig(np.stack([np.eye(3)] * 2), np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([0.0, 250.0]), 1.5)
    covariance = np.zeros((15, 15))
    covariance[10, 10] = 1e-4
    return Adjusted(rig, covariance, 0.4, np.ones(3, bool))


def test_without_the_vertical_the_rig_stays_in_the_first_cameras_axes_in_metres() -> None:
    placed = place_upright(adjusted(), ScaleFound("baseline", 2.0, 0.01))
    np.testing.assert_allclose(placed.adjusted.rig.ps, [[0, 0, 0], [2, 0, 0]])
    assert placed.sigma_baseline_m == pytest.approx(0.02) and "own axes" in placed.frame
    assert placed.adjusted.covariance[10, 10] == pytest.approx(4e-4)
    assert placed.adjusted.rig.lead_px == 1.5 and placed.adjusted.rig.offsets_us[1] == 250


def test_with_the_vertical_z_is_up_and_x_is_where_the_first_camera_looks() -> None:
    T_world_camera = look_at((0.0, 0.0, 1.0), (3.0, 0.0, 0.2))
    up_in_camera = T_world_camera[:3, :3].T @ [0.0, 0.0, 1.0]
    placed = place_upright(adjusted(), ScaleFound("gravity", 2.0, 0.0, up_in_camera))
    np.testing.assert_allclose(placed.adjusted.rig.Rs[0], T_world_camera[:3, :3], atol=1e-12)
    np.testing.assert_allclose(placed.adjusted.rig.ps[1], [0, -2, 0], atol=1e-12)
    assert placed.adjusted.covariance[11, 11] == pytest.approx(4e-4), "turned with the frame"


def test_a_camera_that_looks_straight_down_is_placed_too() -> None:
    placed = place_upright(adjusted(), ScaleFound("gravity", 1.0, 0.0, np.array([0.0, 0.0, -1.0])))
    R = placed.adjusted.rig.Rs[0]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize("length_m", [0.0, -1.0, 1e4, float("nan")])
def test_an_impossible_length_is_refused(length_m: float) -> None:
    with pytest.raises(CalibrationError, match=r"0.001 to 100 m"):
        Scale("wand", length_m)
