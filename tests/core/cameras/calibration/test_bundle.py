import numpy as np
import pytest

from core.cameras import StereoRig, stereo_preset
from core.cameras.calibration.bundle import (
    Rig,
    Sightings,
    _determinants,
    adjust,
    point_information,
    points_of,
    residuals_px,
)

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset("side")
RIG = Rig(
    np.stack([camera.T_world_camera[:3, :3] for camera in CAMERAS.values()]),
    np.stack([camera.position_world_m for camera in CAMERAS.values()]),
    np.zeros(2),
)
FOCALS = np.array([1000.0, 1000.0])


def seen(noise_px: float, count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Points in the world and the pinhole coordinates (N, 2, 2) that the cameras give."""
    rng = np.random.default_rng(0)
    ps = rng.uniform((-1.1, -0.4, 0.05), (0.0, 0.4, 0.6), (count, 3))
    local = [camera.to_camera(ps) for camera in CAMERAS.values()]
    xys = np.stack([p[:, :2] / p[:, 2:] for p in local], axis=1)
    return ps, xys + rng.normal(0, noise_px / 1000.0, xys.shape)


def test_points_are_where_the_rays_meet() -> None:
    ps, xys = seen(0.0)
    np.testing.assert_allclose(points_of(RIG, xys, FOCALS), ps, atol=1e-9)
    assert np.abs(residuals_px(RIG, xys, FOCALS)).max() < 1e-6


def test_points_have_smaller_reprojection_errors_than_where_rays_come_nearest() -> None:
    ps, xys = seen(2.0)
    squares = np.square(residuals_px(RIG, xys, FOCALS)).sum(axis=(1, 2))
    uvs = np.stack([xys[:, k] * 1000.0 + camera.K[:2, 2] for k, camera in enumerate(CAMERAS.values())], axis=1)
    plain = {
        name: type(camera)(camera.sensor, camera.K, np.zeros(5), camera.T_world_camera)
        for name, camera in CAMERAS.items()
    }
    nearest = StereoRig(plain).triangulate(uvs)
    assert (squares <= 2 * nearest.residuals_px**2 + 1e-6).all(), "the sum over both cameras"
    assert np.linalg.norm(points_of(RIG, xys, FOCALS) - ps, axis=1).max() < 0.03


def test_a_point_that_one_camera_sees_is_none() -> None:
    _, xys = seen(0.0, 4)
    xys[0, 1] = np.nan
    xys[1] = np.nan
    found = points_of(RIG, xys, FOCALS)
    assert np.isnan(found[:2]).all() and np.isfinite(found[2:]).all()


def test_the_information_of_points_is_the_inverse_of_their_scatter() -> None:
    ps, exact = seen(0.0, 1)
    rng = np.random.default_rng(1)
    noisy = exact + rng.normal(0, 0.5 / 1000.0, (4000, 2, 2))
    found = points_of(RIG, noisy, FOCALS)
    expected = np.linalg.inv(point_information(RIG, ps, exact, FOCALS, 0.5)[0])
    np.testing.assert_allclose(np.cov(found.T), expected, rtol=0.15, atol=0.05 * expected.max())


CLOCKS = np.array([False] * 13 + [True] + [False])
"""Only the second camera's clock may change."""


def moving(noise_px: float, offset_us: float, seed: int = 0) -> Sightings:
    """A point on a circle, seen by a second camera whose clock is ahead by `offset_us`."""
    rng = np.random.default_rng(seed)
    t_us = np.arange(0, 8_000_000, 20_000)
    noise = rng.normal(0, noise_px / 1000.0, (len(t_us), 2, 2))

    def place(t: np.ndarray) -> np.ndarray:
        angle = 6e-6 * t
        return np.column_stack([-0.5 + 0.4 * np.cos(angle), 0.3 * np.sin(angle), 0.3 + 0.2 * np.sin(2 * angle)])

    def sample(offsets_us: np.ndarray, lead_px: float) -> np.ndarray:
        # At the moment t of the first clock the second one shows t + offset; the picture then is that of `offset_us`.
        at = [t_us + offsets_us[0], t_us + offsets_us[1] - offset_us]
        local = [camera.to_camera(place(t)) for camera, t in zip(CAMERAS.values(), at, strict=True)]
        return np.stack([p[:, :2] / p[:, 2:] for p in local], axis=1) + noise

    return Sightings(t_us, sample, FOCALS)


def test_clocks_are_found_by_what_moves_with_the_standard_deviation_of_many_sweeps() -> None:
    found, claimed = [], []
    for seed in range(40):
        adjusted = adjust(moving(0.5, 2500.0, seed), RIG, CLOCKS, lambda rig: np.empty(0))
        found.append(adjusted.rig.offsets_us[1])
        claimed.append(1e3 * np.sqrt(adjusted.covariance[13, 13]))
        assert adjusted.rig.offsets_us[0] == 0 and np.count_nonzero(adjusted.covariance) == 1
    assert abs(np.mean(found) - 2500.0) < 4 * np.std(found) / np.sqrt(40)
    assert 0.75 < np.std(found) / np.mean(claimed) < 1.33


def test_a_clock_and_a_place_that_trade_for_each_other_are_so_correlated() -> None:
    # What moves along x only: a later picture is the same as a camera farther back along x.
    t_us = np.arange(0, 400_000, 2_000)

    def sample(offsets_us: np.ndarray, lead_px: float) -> np.ndarray:
        parts = []
        for camera, offset in zip(CAMERAS.values(), offsets_us, strict=True):
            s = (t_us + offset) * 1e-6
            ps = np.column_stack([-1.0 + 2.0 * s, 0 * s, 0.3 + 0 * s])
            local = camera.to_camera(ps)
            parts.append(local[:, :2] / local[:, 2:])
        rng = np.random.default_rng(5)
        return np.stack(parts, axis=1) + rng.normal(0, 0.3 / 1000, (len(t_us), 2, 2))

    free = np.zeros(15, bool)
    free[[10, 13]] = True
    sightings = Sightings(t_us, sample, FOCALS)
    adjusted = adjust(sightings, RIG, free, lambda rig: 1e3 * (rig.ps[1, :1] - RIG.ps[1, :1]))
    a, b = adjusted.covariance[10, 10], adjusted.covariance[13, 13]
    assert adjusted.covariance[10, 13] / np.sqrt(a * b) < -0.5, "2 mm farther back is 1 ms later at 2 m/s"


def test_outliers_are_left_out_and_what_is_held_has_no_variance() -> None:
    _, xys = seen(0.3)
    xys[::20, 1, 1] += 0.03
    free = np.ones(15, bool)
    free[:7] = False
    free[[13, 14]] = False
    wrong = Rig(RIG.Rs, RIG.ps + np.array([[0, 0, 0], [0.01, 0.0, -0.01]]), RIG.offsets_us)
    length = np.linalg.norm(RIG.ps[1] - RIG.ps[0])

    def kept_length(rig: Rig) -> np.ndarray:
        return np.array([1e4 * (float(np.linalg.norm(rig.ps[1] - rig.ps[0])) - length)])

    sightings = Sightings(np.arange(300) * 1e5, lambda offsets_us, lead_px: xys, FOCALS)
    found = adjust(sightings, wrong, free, kept_length, rough_px=1.0)
    assert not found.used[::20].any() and found.used.mean() > 0.93
    assert np.linalg.norm(found.rig.ps[1] - RIG.ps[1]) < 0.005
    variances = np.diag(found.covariance)[:-1].reshape(2, 7)
    assert not variances[0].any() and variances[1, :6].all() and variances[1, 6] == 0
    assert 0.25 < found.sigma_px < 0.35


def test_determinants_are_numpys() -> None:
    a = np.random.default_rng(0).normal(size=(50, 3, 3))
    a[0, 0, 1] = a[1, 1, 2] = 0.0
    np.testing.assert_allclose(_determinants(a), np.linalg.det(a), atol=1e-12)
    assert _determinants(np.diag([2.0, 3.0, 5.0])[None])[0] == 30.0
