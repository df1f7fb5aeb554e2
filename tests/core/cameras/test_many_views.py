"""Points from three cameras and more: weights, cameras that see something else, pairs as before."""

import numpy as np
import pytest

from core.cameras import Camera, StereoRig
from core.cameras.presets import camera_preset

pytestmark = pytest.mark.numeric
P = np.array([-0.6, 0.15, 0.2])


@pytest.fixture(scope="module")
def corners() -> dict[str, Camera]:
    return camera_preset("corners")


def pixels(cameras: dict[str, Camera], p: np.ndarray) -> np.ndarray:
    return np.array([camera.project(p[None])[0] for camera in cameras.values()])


def noisy(cameras: dict[str, Camera], sigma_px: np.ndarray, seed: int, count: int = 400) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 1, (count, len(cameras), 2))
    return pixels(cameras, P) + noise * np.asarray(sigma_px)[:, None]


def test_the_point_of_exact_pixels_is_exact(corners) -> None:
    found = StereoRig(corners).triangulate_one(pixels(corners, P))
    assert found is not None and found.cameras == tuple(corners)
    np.testing.assert_allclose(found.p_world_m, P, atol=1e-7)
    assert found.residual_px < 1e-4


def test_every_camera_more_makes_the_point_better(corners) -> None:
    errors = []
    for count in (2, 3, 4):
        part = dict(list(corners.items())[:count])
        found = StereoRig(part).triangulate(noisy(part, np.full(count, 0.3), seed=1))
        errors.append(np.sqrt(np.mean(np.sum((found.ps_world_m - P) ** 2, axis=1))))
    assert errors[2] < 0.95 * errors[1] < 0.9 * errors[0]


def test_a_camera_that_sees_badly_counts_little_if_it_says_so(corners) -> None:
    sigma_px = np.array([0.2, 0.2, 0.2, 2.0])
    uvs = noisy(corners, sigma_px, seed=2)
    rig = StereoRig(corners)
    stated = np.broadcast_to(sigma_px[:, None, None] ** 2 * np.eye(2), (len(uvs), 4, 2, 2))
    told, untold = (
        np.linalg.norm(rig.triangulate(uvs, covariances).ps_world_m - P, axis=1) for covariances in (stated, None)
    )
    assert np.median(told) < 0.6 * np.median(untold)


@pytest.mark.parametrize("wrong", range(4))
@pytest.mark.parametrize("away_px", [8.0, 60.0, 400.0])
def test_something_else_taken_for_the_ball_in_one_of_four_moves_the_point_by_less_than_a_millimetre(
    corners, wrong, away_px
) -> None:
    rig, rng = StereoRig(corners), np.random.default_rng(wrong)
    stated = np.broadcast_to(0.1**2 * np.eye(2), (4, 2, 2))
    for uvs in noisy(corners, np.full(4, 0.1), seed=3, count=40):
        right = rig.triangulate_one(uvs, stated)
        angle = rng.uniform(0, 2 * np.pi)
        uvs[wrong] += away_px * np.array([np.cos(angle), np.sin(angle)])
        found = rig.triangulate_one(uvs, stated)
        assert right is not None and found is not None
        assert list(corners)[wrong] not in found.cameras and len(found.cameras) == 3
        assert np.linalg.norm(found.p_world_m - right.p_world_m) < 1e-3


def test_of_three_the_pair_that_agrees_is_kept(corners) -> None:
    three = dict(list(corners.items())[:3])
    uvs = pixels(three, P)
    uvs[1, 1] += 40.0
    found = StereoRig(three).triangulate_one(uvs)
    assert found is not None and found.cameras == ("near_left", "far_left")
    np.testing.assert_allclose(found.p_world_m, P, atol=1e-6)


def test_two_cameras_that_do_not_agree_are_told_by_their_mismatch(corners) -> None:
    pair = dict(list(corners.items())[:2])
    uvs = pixels(corners, P)
    uvs[0, 1] += 40.0
    assert StereoRig(pair).triangulate_one(uvs[:2]) is None
    uvs[2:] = np.nan
    assert StereoRig(corners).triangulate_one(uvs) is None


def test_two_of_four_give_the_bits_of_a_rig_of_two(corners) -> None:
    pair = dict(list(corners.items())[:2])
    alone = StereoRig(pair).triangulate(noisy(pair, np.full(2, 0.3), seed=5))
    uvs = np.full((400, 4, 2), np.nan)
    uvs[:, :2] = noisy(pair, np.full(2, 0.3), seed=5)
    among = StereoRig(corners).triangulate(uvs)
    for name in ("ps_world_m", "residuals_px", "covariances_m2"):
        np.testing.assert_array_equal(getattr(among, name), getattr(alone, name))


def test_a_rig_with_one_camera_moved_still_gives_points(corners) -> None:
    """An error of the calibration as large as the limit must not silence the rig."""
    three = dict(list(corners.items())[:3])
    uvs = pixels(three, P)
    uvs[2] += (2.5, -2.0)
    found = StereoRig(three).triangulate_one(uvs)
    assert found is not None and np.linalg.norm(found.p_world_m - P) < 0.015
