import cv2
import numpy as np
import pytest

from core.cameras import Camera, StereoRig, TriangulationConfig, stereo_preset
from core.cameras.stereo import interpolate_pixels
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import invert_transform, look_at

pytestmark = pytest.mark.numeric


def points(count: int = 200, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform((-1.3, -0.5, 0.02), (0.3, 0.5, 0.5), (count, 3))


def pixels(cameras: dict[str, Camera], ps: np.ndarray) -> np.ndarray:
    return np.stack([camera.project(ps) for camera in cameras.values()], axis=1)


def three_cameras() -> dict[str, Camera]:
    cameras = stereo_preset("side")
    lens = np.array([-0.3, 0.1, 0.001, 0.0, -0.01])
    K = np.array([[900.0, 0, 640], [0, 905.0, 360], [0, 0, 1]])
    return {**cameras, "top": Camera(SensorSize(1280, 720), K, lens, look_at((-0.9, 0.3, 2.5), (-0.5, 0, 0)))}


@pytest.mark.parametrize("placement", ["side", "ceiling", "behind"])
def test_what_two_cameras_see_is_found_again(placement: str) -> None:
    cameras = stereo_preset(placement)
    found = StereoRig(cameras).triangulate(pixels(cameras, points()))
    np.testing.assert_allclose(found.ps_world_m, points(), atol=1e-9)
    assert found.residuals_px.max() < 1e-6


def test_a_third_camera_with_another_lens_agrees_and_may_be_blind() -> None:
    cameras = three_cameras()
    uvs = pixels(cameras, points(50))
    rig = StereoRig(cameras)
    np.testing.assert_allclose(rig.triangulate(uvs).ps_world_m, points(50), atol=1e-9)
    uvs[:25, 1] = np.nan
    part = rig.triangulate(uvs)
    np.testing.assert_allclose(part.ps_world_m, points(50), atol=1e-9)
    seen_by_two, seen_by_three = (
        part.covariances_m2[rows].trace(axis1=1, axis2=2) for rows in (slice(25), slice(25, 50))
    )
    all_three = rig.triangulate(pixels(cameras, points(50))).covariances_m2[:25].trace(axis1=1, axis2=2)
    assert (seen_by_two > all_three).all() and np.isfinite(seen_by_three).all()


def test_the_point_is_the_nearest_to_both_rays() -> None:
    cameras = stereo_preset()
    rng = np.random.default_rng(1)
    uvs = pixels(cameras, points(20)) + rng.normal(0, 3, (20, 2, 2))
    found = StereoRig(cameras).triangulate(uvs)

    def squares(ps: np.ndarray) -> np.ndarray:
        total = np.zeros(len(ps))
        for index, camera in enumerate(cameras.values()):
            away = ps - camera.position_world_m
            rays = camera.unproject(uvs[:, index])
            total += (np.cross(away, rays) ** 2).sum(axis=1)
        return total

    best = squares(found.ps_world_m)
    for step in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        assert (squares(found.ps_world_m + step) > best).all()


def test_the_residual_is_the_distance_from_the_projections() -> None:
    cameras = stereo_preset()
    uvs = pixels(cameras, points(10)) + np.random.default_rng(2).normal(0, 3, (10, 2, 2))
    found = StereoRig(cameras).triangulate(uvs)
    expected = np.sqrt(((pixels(cameras, found.ps_world_m) - uvs) ** 2).sum(axis=2).mean(axis=1))
    np.testing.assert_allclose(found.residuals_px, expected, rtol=1e-9)


@pytest.mark.parametrize("sigma_px", [0.3, 2.0])
def test_the_covariance_is_that_of_many_noisy_looks(sigma_px: float) -> None:
    cameras = three_cameras()
    truth = np.array([-0.9, 0.2, 0.25])
    rng = np.random.default_rng(3)
    noisy = pixels(cameras, truth[None]) + rng.normal(0, sigma_px, (20_000, 3, 2))
    rig = StereoRig(cameras, TriangulationConfig(sigma_px=sigma_px))
    measured = np.cov(rig.triangulate(noisy).ps_world_m.T)
    claimed = rig.triangulate(pixels(cameras, truth[None])).covariances_m2[0]
    np.testing.assert_allclose(claimed, claimed.T, atol=1e-15)
    whitened = np.linalg.solve(np.linalg.cholesky(claimed), measured)
    whitened = np.linalg.solve(np.linalg.cholesky(claimed), whitened.T)
    np.testing.assert_allclose(whitened, np.eye(3), atol=0.06)


def test_pixels_may_bring_covariances_of_their_own() -> None:
    cameras = three_cameras()
    truth = np.array([-0.9, 0.2, 0.25])
    rng = np.random.default_rng(4)
    halves = rng.normal(0, 0.6, (3, 2, 2))
    covariances = halves @ halves.transpose(0, 2, 1) + 0.05 * np.eye(2)
    noise = np.stack([rng.multivariate_normal([0, 0], one, 20_000) for one in covariances], axis=1)
    rig, exact = StereoRig(cameras), pixels(cameras, truth[None])
    stated = np.broadcast_to(covariances, (20_000, 3, 2, 2))
    measured = np.cov(rig.triangulate(exact + noise, stated).ps_world_m.T)
    claimed = rig.triangulate_one(exact[0], covariances)
    assert claimed is not None
    root = np.linalg.cholesky(claimed.covariance_m2)
    np.testing.assert_allclose(np.linalg.solve(root, np.linalg.solve(root, measured).T), np.eye(3), atol=0.06)
    unsaid = rig.triangulate(exact, np.full((1, 3, 2, 2), np.nan)).covariances_m2
    np.testing.assert_allclose(unsaid, rig.triangulate(exact).covariances_m2, rtol=1e-12)


CROOKED = np.array([-0.2, 0.06, 0.02, -0.015, -0.01])
"""A lens that is mounted askew: tangential terms ten times as large as usual."""


def crooked_cameras() -> dict[str, Camera]:
    K = np.array([[900.0, 0, 640], [0, 905.0, 360], [0, 0, 1]])
    places = {"left": (-1.2, 1.7, 1.1), "right": (-1.1, -1.8, 1.3), "top": (-0.9, 0.3, 2.5)}
    lenses = {"left": CROOKED, "right": CROOKED * [1, 1, -1, 1, 1], "top": CROOKED * [1, 1, 0, -2, 1]}
    return {
        name: Camera(SensorSize(1280, 720), K, lenses[name], look_at(place, (-0.5, 0.05, 0.2)))
        for name, place in places.items()
    }


def opencv_pixels(cameras: dict[str, Camera], ps: np.ndarray) -> np.ndarray:
    parts = []
    for camera in cameras.values():
        T_camera_world = invert_transform(camera.T_world_camera)
        seen = cv2.projectPoints(
            ps, cv2.Rodrigues(T_camera_world[:3, :3])[0], T_camera_world[:3, 3], camera.K, camera.distortion
        )
        parts.append(seen[0].reshape(-1, 2))
    return np.stack(parts, axis=1)


def test_lenses_that_are_mounted_askew_are_those_of_opencv() -> None:
    ps = points(60)
    cameras = crooked_cameras()
    found = StereoRig(cameras).triangulate(opencv_pixels(cameras, ps))
    np.testing.assert_allclose(found.ps_world_m, ps, atol=1e-8)
    assert found.residuals_px.max() < 1e-5


@pytest.mark.parametrize("count", [2, 3])
def test_the_covariance_is_what_each_pixel_moves_the_point_by(count: int) -> None:
    # Where the rays meet in one point, that is exact: sigma^2 times the sum of the squared derivatives by the pixels.
    cameras = dict(list(crooked_cameras().items())[:count])
    rig = StereoRig(cameras, TriangulationConfig(sigma_px=0.7))
    ps = points(8, seed=4)
    uvs = opencv_pixels(cameras, ps)
    expected = np.zeros((8, 3, 3))
    for camera in range(count):
        for axis in range(2):
            step = np.zeros((count, 2))
            step[camera, axis] = 1e-3
            slope = (rig.triangulate(uvs + step).ps_world_m - rig.triangulate(uvs - step).ps_world_m) / 2e-3
            expected += 0.7**2 * slope[:, :, None] * slope[:, None, :]
    found = rig.triangulate(uvs).covariances_m2
    np.testing.assert_allclose(found, expected, atol=1e-5 * expected.max())


def test_one_point_is_a_row_of_many_and_is_gated() -> None:
    cameras = stereo_preset()
    uvs = pixels(cameras, points(5))
    rig = StereoRig(cameras, TriangulationConfig(max_residual_px=5.0))
    many = rig.triangulate(uvs)
    one = rig.triangulate_one(uvs[3])
    assert one is not None
    np.testing.assert_array_equal(one.p_world_m, many.ps_world_m[3])
    np.testing.assert_array_equal(one.covariance_m2, many.covariances_m2[3])
    assert rig.triangulate_one(uvs[3] + [[0, 40], [0, -40]]) is None, "the rays pass each other"
    assert rig.triangulate_one([[np.nan, np.nan], uvs[3, 1]]) is None, "one ray is no point"


def test_rays_that_are_parallel_or_meet_behind_give_nothing() -> None:
    lens, K = np.zeros(5), np.array([[1000.0, 0, 640], [0, 1000.0, 360], [0, 0, 1]])
    side_by_side = {
        name: Camera(SensorSize(1280, 720), K, lens, look_at((-3, y, 0.5), (0, y, 0.5)))
        for name, y in (("left", 0.5), ("right", -0.5))
    }
    rig = StereoRig(side_by_side)
    assert rig.triangulate_one([[640, 360], [640, 360]]) is None
    assert rig.triangulate_one([[540, 360], [740, 360]]) is None, "they part in front and meet behind"
    assert rig.triangulate_one([[740, 360], [540, 360]]) is not None


def test_no_rows_are_legal() -> None:
    assert StereoRig(stereo_preset()).triangulate(np.empty((0, 2, 2))).ps_world_m.shape == (0, 3)


def test_a_rig_without_depth_is_refused() -> None:
    cameras = stereo_preset()
    with pytest.raises(CalibrationError, match="two cameras or more"):
        StereoRig({"left": cameras["left"]})
    with pytest.raises(CalibrationError, match="one place"):
        StereoRig({"left": cameras["left"], "copy": cameras["left"]})
    with pytest.raises(CalibrationError, match=r"\(N, 2, 2\)"):
        StereoRig(cameras).triangulate(np.zeros((4, 3, 2)))


def test_a_track_is_read_between_its_samples_and_nowhere_else() -> None:
    t, uvs = [1000, 3000, 9000], [[0.0, 10.0], [4.0, 20.0], [8.0, 30.0]]
    found = interpolate_pixels(t, uvs, [999, 1000, 1500, 3000, 5000, 9000, 9001], max_gap_us=2000)
    np.testing.assert_allclose(found[[1, 2, 3]], [[0, 10], [1, 12.5], [4, 20]])
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [True, False, False, False, True, False, True])


def test_bringing_both_cameras_to_one_time_keeps_the_depth() -> None:
    cameras = stereo_preset()
    t_us = np.arange(0, 40_000, 2000)
    path = np.array([0.0, 0.1, 0.3]) + t_us[:, None] * 1e-6 * [-9.0, 0.0, 0.0]
    late = path + np.array([-9.0 * 0.001, 0, 0])
    left, right = cameras["left"].project(path), cameras["right"].project(late)
    in_time = interpolate_pixels(t_us + 1000, right, t_us, max_gap_us=4000)
    rig = StereoRig(cameras)
    aligned = rig.triangulate(np.stack([left, in_time], axis=1)[1:]).ps_world_m
    careless = rig.triangulate(np.stack([left, right], axis=1)[1:]).ps_world_m
    assert np.linalg.norm(aligned - path[1:], axis=1).max() < 2e-4
    assert np.linalg.norm(careless - path[1:], axis=1).min() > 3e-3
