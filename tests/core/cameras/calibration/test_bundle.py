import numpy as np

from core.cameras import StereoRig, stereo_preset
from core.cameras.calibration.bundle import Rig, Sightings, adjust, point_information, points_of, residuals_px

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
