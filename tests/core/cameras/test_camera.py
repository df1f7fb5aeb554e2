"""Projection and its inverse, against OpenCV and as laws."""

import itertools

import cv2
import numpy as np
import pytest

from core.cameras import Camera, distortion, stereo_preset
from core.cameras.distortion import distort, fold_radius, undistort
from core.cameras.presets import PLACEMENTS, SENSOR_1280
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import look_at

pytestmark = pytest.mark.numeric
LENSES = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
    "mild": (-0.06, 0.01, 0.0003, -0.0002, 0.0),
    "barrel": (-0.28, 0.09, 0.001, -0.0005, -0.012),
    "pincushion": (0.2, -0.05, 0.0, 0.002, 0.01),
    "askew": (-0.15, 0.05, 0.03, -0.02, -0.01),
}
SENSOR = SensorSize(1280, 720)
K = np.array([[1000.0, 0, 650.3], [0, 1010.0, 342.7], [0, 0, 1]])


def make(lens: str) -> Camera:
    return Camera(SENSOR, K, np.array(LENSES[lens]), look_at((-1.2, 1.7, 1.1), (-0.4, 0.1, 0.1)))


@pytest.fixture(params=LENSES)
def camera(request: pytest.FixtureRequest) -> Camera:
    return make(request.param)


def pixels(camera: Camera, count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform(0, 1, (count, 2)) * [camera.sensor.width_px, camera.sensor.height_px]


def test_projection_is_opencvs(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    ps_camera = np.column_stack([rng.uniform(-0.5, 0.5, (200, 2)), np.ones(200)]) * rng.uniform(0.5, 4, (200, 1))
    T = camera.T_world_camera
    expected = cv2.projectPoints(ps_camera, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0].reshape(-1, 2)
    assert camera.project(ps_camera @ T[:3, :3].T + T[:3, 3]) == pytest.approx(expected, abs=1e-9)


def test_a_pixel_comes_back_from_its_ray_at_any_distance(camera: Camera) -> None:
    uvs = pixels(camera)
    rays = camera.unproject(uvs)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(np.ones(len(rays)))
    for distance_m in (0.1, 2.0, 50.0):
        again = camera.project(camera.position_world_m + distance_m * rays)
        assert np.abs(again - uvs).max() < 1e-6


def test_a_ray_passes_through_the_point_it_came_from(camera: Camera) -> None:
    ps = np.random.default_rng(2).uniform((-0.9, -0.4, 0.0), (0.2, 0.5, 0.3), (100, 3))
    to_point = ps - camera.position_world_m
    to_point /= np.linalg.norm(to_point, axis=1, keepdims=True)
    assert camera.unproject(camera.project(ps)) == pytest.approx(to_point, abs=1e-9)


def test_the_way_back_through_the_lens_doubles_its_digits_with_each_round(monkeypatch) -> None:
    # Newton's method does that with the right derivatives only; with wrong ones it creeps there in the 20 rounds.
    lens = np.array(LENSES["askew"])
    xys = np.random.default_rng(3).uniform(-0.45, 0.45, (200, 2))
    errors = []
    for rounds in (1, 2, 3):
        monkeypatch.setattr(distortion, "NEWTON_ROUNDS", rounds)
        monkeypatch.setattr(distortion, "WRONG", np.inf)
        errors.append(np.abs(undistort(distort(xys, lens), lens) - xys).max(axis=1))
    assert errors[0].max() > 5e-4
    for before, after in itertools.pairwise(errors):
        assert (after <= 3.0 * before**2 + 1e-14).all()


def test_pixel_zero_is_the_centre_of_the_top_left_pixel() -> None:
    camera = Camera(SENSOR, K, np.zeros(5), np.eye(4))
    assert camera.project([[(-650.3) / 1000, (-342.7) / 1010, 1.0]]) == pytest.approx(np.zeros((1, 2)), abs=1e-9)
    assert camera.project([[0.0, 0.0, 3.0]]) == pytest.approx(np.array([[650.3, 342.7]]))


def test_what_is_behind_the_camera_is_nowhere() -> None:
    camera = Camera(SENSOR, K, np.zeros(5), np.eye(4))
    assert np.isnan(camera.project([[0, 0, -1.0], [0, 0, 0.0]])).all()
    assert camera.project(np.empty((0, 3))).shape == (0, 2)
    assert camera.undistort(np.empty((0, 2))).shape == (0, 2)


def test_strong_distortion_folds_nothing_into_the_picture() -> None:
    camera = Camera(SENSOR, K, np.array([-0.3, 0.0, 0, 0, 0]), np.eye(4))
    edge = fold_radius(camera.distortion)
    assert edge == pytest.approx(1 / np.sqrt(0.9))
    inside, outside = camera.project([[0.99 * edge, 0, 1.0], [1.5 * edge, 0, 1.0]])
    assert np.isfinite(inside).all() and np.isnan(outside).all()
    farthest = float(distort(np.array([[edge, 0.0]]), camera.distortion)[0, 0])
    found = undistort(np.array([[0.9 * farthest, 0.0], [1.1 * farthest, 0.0]]), camera.distortion)
    assert found[0, 0] < edge and np.isnan(found[1]).all()


def test_a_camera_with_impossible_values_is_refused() -> None:
    good = {"sensor": SENSOR, "K": K, "distortion": np.zeros(5), "T_world_camera": np.eye(4)}
    skewed = K + np.array([[0, 0.5, 0], [0, 0, 0], [0, 0, 0]])
    wrong = [
        {"K": np.diag([-1.0, 1, 1])},
        {"K": np.eye(2)},
        {"K": skewed},
        {"distortion": np.zeros(4)},
        {"distortion": np.full(5, np.inf)},
        {"T_world_camera": np.diag([1.0, 1, 2, 1])},
        {"K": K * [[1e12], [1], [1]]},
        {"distortion": np.full(5, 1e12)},
        {"T_world_camera": np.eye(4) + np.eye(4)[:, [1, 2, 3, 0]] * [0, 0, 0, -1e300]},
    ]
    for change in wrong:
        with pytest.raises(CalibrationError):
            Camera(**{**good, **change})


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("sensor", [SENSOR, SENSOR_1280])
def test_presets_are_mirror_images_that_see_the_bounce_and_the_hitting_plane(
    placement: str, sensor: SensorSize
) -> None:
    cameras = stereo_preset(placement, sensor)
    assert list(cameras) == ["left", "right"]
    left, right = cameras["left"].position_world_m, cameras["right"].position_world_m
    assert left[1] > 0 and right == pytest.approx(left * [1, -1, 1])
    for camera in cameras.values():
        uvs = camera.project([(-0.8, 0.0, 0.02), (-1.42, 0.1, 0.25), (-1.42, -0.1, 0.25), (0.0, 0.0, 0.2)])
        assert (uvs > 0).all() and (uvs < [sensor.width_px, sensor.height_px]).all()


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_presets_see_most_of_the_robots_half_and_the_square_sensor_all_of_it(placement: str) -> None:
    xs, ys = np.meshgrid(np.linspace(-1.37, 0, 28), np.linspace(-0.7625, 0.7625, 31))
    ps = np.column_stack([xs.ravel(), ys.ravel(), np.zeros(xs.size)])
    for sensor, share in ((SENSOR, 0.9), (SENSOR_1280, 1.0)):
        for camera in stereo_preset(placement, sensor).values():
            uvs = camera.project(ps)
            seen = ((uvs >= 0) & (uvs <= [sensor.width_px - 1, sensor.height_px - 1])).all(axis=1)
            assert seen.mean() >= share


def test_an_unknown_preset_is_named() -> None:
    with pytest.raises(CalibrationError, match="cellar"):
        stereo_preset("cellar")
