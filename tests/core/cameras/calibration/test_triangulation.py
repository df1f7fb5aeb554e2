import numpy as np
import pytest

from core.cameras import StereoRig, stereo_preset
from core.cameras.calibration.triangulation import inverses, point_information, points_of

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset("side")
POSES = np.stack([camera.T_world_camera for camera in CAMERAS.values()])
FOCALS = np.array([1000.0, 1000.0])


def seen(noise_px: float, count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Points in the world and the pinhole coordinates (N, 2, 2) that the cameras give."""
    rng = np.random.default_rng(0)
    ps = rng.uniform((-1.1, -0.4, 0.05), (0.0, 0.4, 0.6), (count, 3))
    local = [camera.to_camera(ps) for camera in CAMERAS.values()]
    xys = np.stack([p[:, :2] / p[:, 2:] for p in local], axis=1)
    return ps, xys + rng.normal(0, noise_px / 1000.0, xys.shape)


def errors_px(ps: np.ndarray, xys: np.ndarray) -> np.ndarray:
    """(N, 2, 2) seen minus projected."""
    local = [camera.to_camera(ps) for camera in CAMERAS.values()]
    return 1000.0 * (xys - np.stack([p[:, :2] / p[:, 2:] for p in local], axis=1))


def test_points_are_where_the_rays_meet() -> None:
    ps, xys = seen(0.0)
    np.testing.assert_allclose(points_of(POSES, xys, FOCALS), ps, atol=1e-9)
    assert np.abs(errors_px(points_of(POSES, xys, FOCALS), xys)).max() < 1e-6


def test_points_have_smaller_reprojection_errors_than_where_rays_come_nearest() -> None:
    ps, xys = seen(2.0)
    squares = np.square(errors_px(points_of(POSES, xys, FOCALS), xys)).sum(axis=(1, 2))
    uvs = np.stack([xys[:, k] * 1000.0 + camera.K[:2, 2] for k, camera in enumerate(CAMERAS.values())], axis=1)
    plain = {
        name: type(camera)(camera.sensor, camera.K, np.zeros(5), camera.T_world_camera)
        for name, camera in CAMERAS.items()
    }
    nearest = StereoRig(plain).triangulate(uvs)
    assert (squares <= 2 * nearest.residuals_px**2 + 1e-6).all(), "the sum over both cameras"
    assert np.linalg.norm(points_of(POSES, xys, FOCALS) - ps, axis=1).max() < 0.03


def test_a_point_that_one_camera_sees_is_none() -> None:
    _, xys = seen(0.0, 4)
    xys[0, 1] = np.nan
    xys[1] = np.nan
    found = points_of(POSES, xys, FOCALS)
    assert np.isnan(found[:2]).all() and np.isfinite(found[2:]).all()


def test_the_information_of_points_is_the_inverse_of_their_scatter() -> None:
    ps, exact = seen(0.0, 1)
    rng = np.random.default_rng(1)
    noisy = exact + rng.normal(0, 0.5 / 1000.0, (4000, 2, 2))
    found = points_of(POSES, noisy, FOCALS)
    expected = np.linalg.inv(point_information(POSES, ps, exact, FOCALS, 0.5)[0])
    np.testing.assert_allclose(np.cov(found.T), expected, rtol=0.15, atol=0.05 * expected.max())


def test_inverses_are_numpys_and_none_is_of_what_is_singular() -> None:
    a = np.random.default_rng(0).normal(size=(50, 4, 3))
    a = a.transpose(0, 2, 1) @ a
    found = inverses(a)
    np.testing.assert_allclose(found, np.linalg.inv(a), rtol=1e-8)
    assert inverses(np.diag([2.0, 4.0, 5.0])[None])[0].tolist() == np.diag([0.5, 0.25, 0.2]).tolist()
    flat = np.outer([1.0, 2, 3], [1.0, 2, 3]) + np.outer([0.0, 1, 1], [0.0, 1, 1])
    assert not inverses(np.stack([flat, np.zeros((3, 3))])).any()
