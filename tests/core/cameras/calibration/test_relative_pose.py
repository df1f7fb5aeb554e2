import numpy as np
import pytest

from core.cameras import stereo_preset
from core.cameras.calibration.rig_chain import guess_relative_pose, sampson_distance
from core.errors import CalibrationError
from core.geometry import invert_transform

pytestmark = pytest.mark.numeric
LEFT, RIGHT = stereo_preset("side").values()
T_LEFT_RIGHT = invert_transform(LEFT.T_world_camera) @ RIGHT.T_world_camera


def seen(count: int, strays: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    ps = rng.uniform((-1.1, -0.4, 0.05), (0.0, 0.4, 0.6), (count, 3))
    first, second = (camera.undistort(camera.project(ps)) for camera in (LEFT, RIGHT))
    second[:strays] += rng.uniform(-0.3, 0.3, (strays, 2))
    return first, second


def test_the_pose_is_found_among_strays_at_the_offset_where_most_agree() -> None:
    first, second = seen(200, strays=30)
    wrong = second + np.random.default_rng(1).normal(0, 0.03, second.shape)
    found = guess_relative_pose(first, lambda at: second if at == 2000 else wrong, np.array([0.0, 2000, 4000]), 1000.0)
    assert found.offset_us == 2000 and found.agreeing > 0.8
    np.testing.assert_allclose(found.T_first_second[:3, :3], T_LEFT_RIGHT[:3, :3], atol=1e-4)
    expected = T_LEFT_RIGHT[:3, 3] / np.linalg.norm(T_LEFT_RIGHT[:3, 3])
    np.testing.assert_allclose(found.T_first_second[:3, 3], expected, atol=1e-4)


def test_the_distance_from_the_epipolar_line_is_zero_for_one_point_and_grows_with_the_error() -> None:
    first, second = seen(50)
    t = -T_LEFT_RIGHT[:3, :3].T @ T_LEFT_RIGHT[:3, 3]
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    E = cross @ T_LEFT_RIGHT[:3, :3].T
    assert sampson_distance(E, first, second).max() < 1e-9
    one, two = (sampson_distance(E, first, second + np.array([0.0, step])) for step in (1e-4, 2e-4))
    np.testing.assert_allclose(two, 2 * one, rtol=0.01)


def test_too_few_common_sightings_are_refused_with_their_number() -> None:
    first, second = seen(40)
    second[12:] = np.nan
    with pytest.raises(CalibrationError, match="expected 30 common sightings or more, got 12"):
        guess_relative_pose(first, lambda at: second, np.zeros(1), 1000.0)


def test_thirty_common_sightings_are_enough_and_one_less_is_not() -> None:
    first, second = seen(30)
    found = guess_relative_pose(first, lambda at: second, np.zeros(1), 1000.0)
    np.testing.assert_allclose(found.T_first_second[:3, :3], T_LEFT_RIGHT[:3, :3], atol=1e-4)
    with pytest.raises(CalibrationError, match="got 29"):
        guess_relative_pose(first[:29], lambda at: second[:29], np.zeros(1), 1000.0)
