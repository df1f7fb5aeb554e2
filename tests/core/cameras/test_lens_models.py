"""Lens models beyond five coefficients: the values are OpenCV's, and everything that uses a camera follows them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from core.cameras import Camera, StereoRig, ball_circles, load_calibration, save_calibration
from core.cameras.calibration.intrinsics import save_lens
from core.cameras.calibration.table_corners import CORNERS, Clicks, pose_from_clicks
from core.cameras.stereo import EpipolarPair
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import look_at, make_transform
from core.live.link.fields import read_fields, write_fields
from core.live.link.messages import CameraInfo
from core.recordings import open_recording
from core.recordings.writer import RecordingWriter
from core.simulation.scenes.lens import lens_of, project_from_camera

pytestmark = pytest.mark.numeric
SENSOR = SensorSize(1280, 720)
K = np.array([[420.0, 0, 639.5], [0, 415.0, 359.5], [0, 0, 1]])
FISHEYE = np.array([0.05, -0.01, 0.002, -0.001])
MANY = [-0.2, 0.05, 0.001, -0.002, 0.01, 0.03, -0.02, 0.004, 0.001, -0.002, 0.0005, 0.0007, 0.02, -0.03]
PLACES = {"left": look_at((-1.15, 1.0, 0.9), (-0.4, 0.0, 0.1)), "right": look_at((-1.2, -1.0, 0.9), (-0.4, 0.0, 0.1))}
RIG = {name: Camera(SENSOR, K, FISHEYE, pose, "fisheye") for name, pose in PLACES.items()}
PS = np.random.default_rng(2).uniform((-1.2, -0.6, 0.05), (0.5, 0.6, 0.7), (60, 3))


def pixels_of_opencv(camera: Camera, ps_camera: np.ndarray) -> np.ndarray:
    zero = np.zeros(3)
    if camera.model == "fisheye":
        found, _ = cv2.fisheye.projectPoints(ps_camera[:, None], zero, zero, camera.K, camera.distortion)
    else:
        found, _ = cv2.projectPoints(ps_camera, zero, zero, camera.K, camera.distortion)
    return np.asarray(found).reshape(-1, 2)


@pytest.mark.parametrize("count", [5, 8, 12, 14])
def test_pinholes_of_all_lengths_project_as_opencv_does_and_back(count: int) -> None:
    camera = Camera(SENSOR, K, np.array(MANY[:count]), np.eye(4))
    rng = np.random.default_rng(0)
    ps = np.column_stack([rng.uniform(-0.7, 0.7, 300), rng.uniform(-0.5, 0.5, 300), np.ones(300)])
    ps *= rng.uniform(0.5, 3.0, (300, 1))
    uvs = camera.project(ps)
    np.testing.assert_allclose(uvs, pixels_of_opencv(camera, ps), atol=1e-9)
    np.testing.assert_allclose(camera.undistort(uvs), ps[:, :2] / ps[:, 2:], atol=1e-12)


def test_a_fisheye_lens_projects_as_opencv_does_and_back_up_to_the_side() -> None:
    camera = Camera(SENSOR, K, FISHEYE, np.eye(4), "fisheye")
    rng = np.random.default_rng(1)
    angle, around = rng.uniform(0.0, np.radians(85), 300), rng.uniform(0, 2 * np.pi, 300)
    ps = 2 * np.column_stack([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)])
    uvs = camera.project(ps)
    np.testing.assert_allclose(uvs, pixels_of_opencv(camera, ps), atol=1e-9)
    np.testing.assert_allclose(camera.unproject(uvs), ps / 2, atol=1e-12)
    near = angle < np.radians(50)  # where OpenCV's ten rounds are enough
    opencv = cv2.fisheye.undistortPoints(uvs[near, None], K, FISHEYE).reshape(-1, 2)
    np.testing.assert_allclose(camera.undistort(uvs[near]), opencv, atol=1e-6)
    assert np.isnan(camera.project([[1.0, 0.0, -0.1]])).all(), "behind the camera"
    far = K[:2, 2] + (420 * 3.0, 0.0)
    assert np.isnan(camera.undistort([far])).all(), "beyond 90 degrees no pinhole coordinates"


def test_a_fisheye_lens_that_turns_back_folds_nothing_into_the_picture() -> None:
    camera = Camera(SENSOR, K, np.array([-0.3, 0.0, 0.0, 0.0]), np.eye(4), "fisheye")
    fold = np.sqrt(1 / 0.9)  # 1 - 3 * 0.3 angle^2 = 0
    inside, outside = (np.tan(fold + step) for step in (-0.05, 0.05))
    uvs = camera.project([[inside, 0.0, 1.0], [outside, 0.0, 1.0]])
    assert np.isfinite(uvs[0]).all() and np.isnan(uvs[1]).all()
    np.testing.assert_allclose(camera.undistort(uvs[:1])[0, 0], inside, rtol=1e-9)
    assert np.isnan(camera.undistort([K[:2, 2] + (420 * 0.72, 0.0)])).all(), "the picture ends at 0.703 focal lengths"


@pytest.mark.parametrize(("model", "distortion"), [("pinhole", MANY), ("pinhole", MANY[:8]), ("fisheye", FISHEYE)])
def test_slopes_are_those_of_the_projection(model, distortion) -> None:
    camera = Camera(SENSOR, K, np.array(distortion), np.eye(4), model)
    xys = np.random.default_rng(3).uniform(-0.6, 0.6, (40, 2))
    step = 1e-6

    def pixels(shift: tuple[float, float]) -> np.ndarray:
        return camera.project(np.column_stack([xys + shift, np.ones(len(xys))]))

    by_x = (pixels((step, 0)) - pixels((-step, 0))) / (2 * step)
    by_y = (pixels((0, step)) - pixels((0, -step))) / (2 * step)
    np.testing.assert_allclose(camera.pixel_slopes(xys), np.stack([by_x, by_y], axis=-1), atol=1e-4)


@pytest.mark.parametrize(("model", "distortion"), [("fisheye", FISHEYE), ("pinhole", np.array(MANY[:12]))])
def test_points_are_found_again_by_two_cameras(model, distortion) -> None:
    rig = {name: Camera(SENSOR, K, distortion, pose, model) for name, pose in PLACES.items()}
    uvs = np.stack([camera.project(PS) for camera in rig.values()], axis=1)
    found = StereoRig(rig).triangulate(uvs)
    np.testing.assert_allclose(found.ps_world_m, PS, atol=1e-9)
    assert found.residuals_px.max() < 1e-6
    noise = np.random.default_rng(4).normal(0, 0.5, (400, 1, 2, 2))
    one = StereoRig(rig).triangulate(uvs[:1] + noise[:, 0], np.broadcast_to(0.25 * np.eye(2), (400, 2, 2, 2)))
    spread, told = np.cov(one.ps_world_m.T), one.covariances_m2.mean(axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(told)), np.sqrt(np.diag(spread)), rtol=0.15)


def test_epipolar_distances_of_a_fisheye_pair_are_pixels_across_the_line() -> None:
    pair = EpipolarPair(RIG["left"], RIG["right"])
    first, second = (camera.project(PS) for camera in RIG.values())
    assert np.abs(pair.residuals_px(first, second)).max() < 1e-9
    depths = np.array([-0.02, 0.02])
    for index in range(5):
        ray = RIG["left"].unproject(first[index])[0]
        along = np.diff(RIG["right"].project(PS[index] + depths[:, None] * ray), axis=0)[0]
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        off = pair.residuals_px(first[index : index + 1], second[index : index + 1] + 2.0 * across)[0]
        assert 1.0 <= abs(off) <= 2.9  # the root mean square of both pictures; the other one's scale is another


def test_the_simulation_sees_what_the_camera_sees() -> None:
    camera = RIG["left"]
    lens = lens_of(camera)
    for p, expected in zip(camera.to_camera(PS[:10]), camera.project(PS[:10]), strict=True):
        np.testing.assert_allclose(project_from_camera(lens, *p), expected, atol=1e-9)
    circles = ball_circles(camera, PS[:10])
    assert (
        np.hypot(circles.u_px - camera.project(PS[:10])[:, 0], circles.v_px - camera.project(PS[:10])[:, 1]).max() < 1
    )


def test_clicked_corners_place_a_fisheye_camera() -> None:
    camera = RIG["left"]
    names = tuple(name for name, p in CORNERS.items() if np.isfinite(camera.project([p])).all())
    clicks = Clicks(names, camera.project([CORNERS[name] for name in names]))
    np.testing.assert_allclose(pose_from_clicks(camera, clicks, "left"), camera.T_world_camera, atol=1e-5)


def test_files_recordings_and_messages_keep_the_model(tmp_path: Path) -> None:
    save_calibration(tmp_path / "rig.toml", RIG)
    save_lens(tmp_path / "lens.yaml", "left", RIG["left"])
    with RecordingWriter(tmp_path / "r.h5", dict.fromkeys(RIG, SENSOR), calibration=RIG):
        pass
    with open_recording(tmp_path / "r.h5") as recording:
        recorded = {name: stream.calibration for name, stream in recording.cameras.items()}
    sent = read_fields(CameraInfo, write_fields(CameraInfo.of("left", RIG["left"])), "camera")
    for found in (
        load_calibration(tmp_path / "rig.toml")["left"],
        load_calibration(tmp_path / "lens.yaml")["camera"],
        recorded["left"],
        sent.camera(),
    ):
        assert found is not None and found.model == "fisheye"
        np.testing.assert_array_equal(found.distortion, FISHEYE)


def test_a_pinhole_reader_finds_no_distortion_in_the_recording_of_a_fisheye_lens(tmp_path: Path) -> None:
    import h5py

    pinhole = Camera(SENSOR, K, np.array(MANY[:8]), make_transform(np.eye(3), (0, 0, 0)))
    cameras = {"left": RIG["left"], "right": pinhole}
    with RecordingWriter(tmp_path / "r.h5", dict.fromkeys(cameras, SENSOR), calibration=cameras):
        pass
    with h5py.File(tmp_path / "r.h5") as file:
        fisheye, flat = file["cameras/left/calibration"], file["cameras/right/calibration"]
        assert "distortion" not in fisheye and fisheye.attrs["lens_model"] == "fisheye"
        assert flat["distortion"][()].tolist() == MANY[:8] and not dict(flat.attrs)


def test_impossible_lenses_are_refused() -> None:
    for model, distortion in (("fisheye", np.zeros(5)), ("pinhole", np.zeros(4)), ("omni", np.zeros(4))):
        with pytest.raises(CalibrationError):
            Camera(SENSOR, K, distortion, np.eye(4), model)  # pyright: ignore[reportArgumentType]
