import numpy as np
import pytest

from core.cameras import Camera
from core.cameras.calibration.bundle import SIZE, Adjusted, Rig
from core.cameras.calibration.placement import place_upright
from core.cameras.calibration.scale import Scale, ScaleFound
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import look_at, make_transform

pytestmark = pytest.mark.numeric


LENS = np.array([[1000.0, 0, 640], [0, 1000, 360], [0, 0, 1]])
X, Y = SIZE + 3, SIZE + 4
"""Columns of the second camera's place."""


def adjusted() -> Adjusted:
    """The second camera 1 to the right of the first, its position uncertain by 0.01 along x of the first."""
    places = ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    cameras = [Camera(SensorSize(1280, 720), LENS, np.zeros(5), make_transform(np.eye(3), place)) for place in places]
    rig = Rig(tuple(cameras), np.array([0.0, 250.0]), np.zeros(2), 1.5)
    covariance = np.zeros((2 * SIZE + 1, 2 * SIZE + 1))
    covariance[X, X] = 1e-4
    return Adjusted(rig, covariance, 0.4, np.zeros(3), np.ones((3, 1, 2), bool))


def test_without_the_vertical_the_rig_stays_in_the_first_cameras_axes_in_metres() -> None:
    placed = place_upright(adjusted(), ScaleFound("baseline", 2.0, 0.01))
    np.testing.assert_allclose(placed.adjusted.rig.poses[:, :3, 3], [[0, 0, 0], [2, 0, 0]])
    assert "own axes" in placed.frame
    assert placed.adjusted.covariance[X, X] == pytest.approx(4e-4 + 0.02**2), "0.01 in units, and the scale's own"
    assert placed.adjusted.rig.lead_px == 1.5 and placed.adjusted.rig.offsets_us[1] == 250


def test_with_the_vertical_z_is_up_and_x_is_where_the_first_camera_looks() -> None:
    T_world_camera = look_at((0.0, 0.0, 1.0), (3.0, 0.0, 0.2))
    up_in_camera = T_world_camera[:3, :3].T @ [0.0, 0.0, 1.0]
    placed = place_upright(adjusted(), ScaleFound("gravity", 2.0, 0.0, up_in_camera))
    np.testing.assert_allclose(placed.adjusted.rig.poses[0, :3, :3], T_world_camera[:3, :3], atol=1e-12)
    np.testing.assert_allclose(placed.adjusted.rig.cameras[1].position_world_m, [0, -2, 0], atol=1e-12)
    assert placed.adjusted.covariance[Y, Y] == pytest.approx(4e-4), "turned with the frame"


def test_a_camera_that_looks_straight_down_is_placed_too() -> None:
    placed = place_upright(adjusted(), ScaleFound("gravity", 1.0, 0.0, np.array([0.0, 0.0, -1.0])))
    R = placed.adjusted.rig.poses[0, :3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize("length_m", [0.0, -1.0, 1e4, float("nan")])
def test_an_impossible_length_is_refused(length_m: float) -> None:
    with pytest.raises(CalibrationError, match=r"0.001 to 100 m"):
        Scale("wand", length_m)
