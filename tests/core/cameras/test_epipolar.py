"""Distances from epipolar lines, and the part of them that a moved camera explains."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.cameras import Camera, stereo_preset
from core.cameras.stereo import EpipolarDrift, EpipolarPair
from core.errors import CalibrationError
from core.geometry import make_transform

pytestmark = pytest.mark.numeric


def points(count: int = 300) -> np.ndarray:
    return np.random.default_rng(0).uniform((-1.3, -0.5, 0.02), (0.3, 0.5, 0.5), (count, 3))


def turned(camera: Camera, rotvec: tuple[float, float, float]) -> Camera:
    T = camera.T_world_camera
    return replace(
        camera, T_world_camera=make_transform(T[:3, :3] @ Rotation.from_rotvec(rotvec).as_matrix(), T[:3, 3])
    )


@pytest.mark.parametrize("placement", ["side", "ceiling", "behind"])
def test_true_sightings_lie_on_their_lines_and_the_distance_is_that_across_them(placement: str) -> None:
    left, right = stereo_preset(placement).values()
    pair = EpipolarPair(left, right)
    first, second = left.project(points()), right.project(points())
    assert np.abs(pair.residuals_px(first, second)).max() < 1e-6
    step = np.array([0.3, 0.4])
    one_way, other_way = pair.residuals_px(first + step, second), pair.residuals_px(first - step, second)
    np.testing.assert_allclose(one_way, -other_way, atol=0.02)
    assert np.abs(one_way).max() < 0.75  # the other picture's distance is its own, up to the ratio of the depths
    assert np.isnan(pair.residuals_px([[np.nan, 0.0]], [[1.0, 2.0]])).all()


def test_a_turn_of_one_camera_is_measured_through_noise_and_strays() -> None:
    left, right = stereo_preset("side").values()
    moved = EpipolarPair(left, turned(right, (1e-3, 0.0, 4e-4)))
    rng = np.random.default_rng(1)
    first, second = left.project(points()), right.project(points())
    exact_px = float(np.sqrt(np.mean(np.square(moved.residuals_px(first, second)))))
    assert exact_px > 0.5
    noisy = second + rng.normal(0, 0.5, second.shape)
    noisy[::20] += rng.normal(0, 60, noisy[::20].shape)
    found = moved.fit(first + rng.normal(0, 0.5, first.shape), noisy)
    assert abs(found.drift_px - exact_px) < 4 * found.sigma_px < 0.5
    assert EpipolarPair(left, right).fit(first, noisy).drift_px < 0.2


def test_what_no_pose_explains_is_noise_and_not_drift() -> None:
    left, right = stereo_preset("side").values()
    noise = np.random.default_rng(2).normal(0, 3.0, (300, 2))
    found = EpipolarPair(left, right).fit(left.project(points()), right.project(points()) + noise)
    assert 1.5 < found.noise_px < 4.5 and found.drift_px < 3 * found.sigma_px


def test_it_refuses_too_few_sightings_and_cameras_in_one_place() -> None:
    left, right = stereo_preset("side").values()
    with pytest.raises(CalibrationError, match=r"too few sightings.*more than 5.*got 5"):
        EpipolarPair(left, right).fit(left.project(points(5)), right.project(points(5)))
    with pytest.raises(CalibrationError, match="in one place"):
        EpipolarPair(left, left)


def test_the_same_change_is_told_of_places_where_nothing_was_seen() -> None:
    left, right = stereo_preset("side").values()
    moved = EpipolarPair(left, turned(right, (1e-3, 0.0, 4e-4)))
    seen = points()[points()[:, 0] < -0.6]  # the robot's end of the table
    everywhere = np.random.default_rng(5).uniform((-1.3, -0.7, 0.02), (1.3, 0.7, 0.5), (400, 3))
    off_px = moved.residuals_px(left.project(everywhere), right.project(everywhere))
    truth_px = float(np.sqrt(np.mean(np.square(off_px))))
    rng = np.random.default_rng(1)
    first, second = (one.project(seen) + rng.normal(0, 0.4, (len(seen), 2)) for one in (left, right))
    found = moved.fit(first, second, moved.slopes_px(everywhere))
    assert found.elsewhere_px is not None and found.elsewhere_sigma_px > found.sigma_px
    assert abs(found.elsewhere_px - truth_px) < 3 * found.elsewhere_sigma_px < 0.9
    assert moved.fit(first, second) == EpipolarDrift(found.drift_px, found.noise_px, found.sigma_px)
    fits = EpipolarPair(left, right).fit(first, second, moved.slopes_px(everywhere))
    assert fits.elsewhere_px is not None and fits.elsewhere_px < 0.4
