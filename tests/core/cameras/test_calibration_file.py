"""Calibration files: ours, OpenCV's as OpenCV writes it, Kalibr's, and what is none of them."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.cameras import Camera, load_calibration, save_calibration, stereo_preset
from core.cameras.calibration_values import CalibrationNode, read_numbers
from core.errors import CalibrationError
from core.geometry import invert_transform, look_at, make_transform

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset()
LEFT, RIGHT = CAMERAS["left"], CAMERAS["right"]
T_RIGHT_LEFT = invert_transform(RIGHT.T_world_camera) @ LEFT.T_world_camera

KALIBR = """
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [1001.0, 1002.0, 639.5, 359.5]
  resolution: [1280, 720]
  rostopic: /left/events
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.5]
  - [0.0, 1.0, 0.0, 0.01]
  - [0.0, 0.0, 1.0, 0.02]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [990.0, 991.0, 640.0, 360.0]
  resolution: [1280, 720]
"""


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "calibration.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def write_opencv(path: Path, values: Mapping[str, int | np.ndarray]) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in values.items():
        storage.write(key, value)
    storage.release()
    return path


def assert_same(one: Camera, two: Camera) -> None:
    assert one.sensor == two.sensor
    for field in ("K", "distortion"):
        assert getattr(one, field) == pytest.approx(getattr(two, field))
    assert one.T_world_camera == pytest.approx(two.T_world_camera, abs=1e-9)


def test_ours_comes_back_bit_for_bit_and_in_order(tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "rig.toml"
    cameras = {"zenith": LEFT, "a camera with spaces": RIGHT}
    save_calibration(path, cameras)
    loaded = load_calibration(path)
    assert list(loaded) == list(cameras)
    for name, camera in cameras.items():
        for field in ("K", "distortion", "T_world_camera"):
            assert np.array_equal(getattr(loaded[name], field), getattr(camera, field))
        assert loaded[name].sensor == camera.sensor
    assert [file.name for file in path.parent.iterdir()] == ["rig.toml"]


def test_opencvs_stereo_file_as_opencv_writes_it(tmp_path: Path) -> None:
    path = write_opencv(
        tmp_path / "stereo.yml",
        {
            "image_width": 1280,
            "image_height": 720,
            "M1": LEFT.K,
            "D1": LEFT.distortion.reshape(1, 5),
            "M2": RIGHT.K,
            "D2": RIGHT.distortion.reshape(5, 1),
            "R": T_RIGHT_LEFT[:3, :3],
            "T": T_RIGHT_LEFT[:3, 3:],
            "T_world_camera": LEFT.T_world_camera,
        },
    )
    loaded = load_calibration(path)
    assert list(loaded) == ["left", "right"]
    assert_same(loaded["left"], LEFT)
    assert_same(loaded["right"], RIGHT)


def test_opencvs_single_camera_file_in_its_old_dialect(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        """%YAML:1.0
---
calibration_time: "Mon 03 Aug 2026"
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.3e+02, 0., 3.195e+02, 0., 5.3e+02, 2.395e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ -2.5e-01, 8.0e-02, 1.0e-03, 0. ]
avg_reprojection_error: 2.5e-01
""",
    )
    camera = load_calibration(path)["camera"]
    assert str(camera.sensor) == "640x480" and camera.K[0, 0] == 530 and camera.K[1, 2] == 239.5
    assert camera.distortion.tolist() == [-0.25, 0.08, 0.001, 0.0, 0.0]
    assert camera.T_world_camera == pytest.approx(np.eye(4))


def test_kalibrs_chain_is_followed_from_camera_to_camera(tmp_path: Path) -> None:
    third = KALIBR.replace("cam1:", "cam2:").split("cam2:")[1]
    loaded = load_calibration(write(tmp_path, KALIBR + "cam2:" + third))
    assert list(loaded) == ["cam0", "cam1", "cam2"]
    assert loaded["cam0"].K.tolist() == [[1001, 0, 639.5], [0, 1002, 359.5], [0, 0, 1]]
    assert loaded["cam0"].distortion.tolist() == [-0.1, 0.02, 0.001, -0.002, 0]
    assert loaded["cam1"].T_world_camera[:3, 3] == pytest.approx([0.5, -0.01, -0.02])
    assert loaded["cam2"].T_world_camera[:3, 3] == pytest.approx([1.0, -0.02, -0.04])


def test_kalibrs_turned_camera_sees_what_the_first_one_sees(tmp_path: Path) -> None:
    T = invert_transform(look_at((1.0, 0.2, 0.1), (0.0, 3.0, 0.3)))
    rows = "\n".join(f"  - {row}" for row in T.tolist())
    head, tail = KALIBR.split("  T_cn_cnm1:\n")
    loaded = load_calibration(write(tmp_path, f"{head}  T_cn_cnm1:\n{rows}\n{tail[tail.index('  camera_model') :]}"))
    p_first = np.array([0.1, 2.5, 0.2])
    p_second = T @ [*p_first, 1.0]
    K = loaded["cam1"].K
    expected = (K @ p_second[:3])[:2] / p_second[2]
    assert loaded["cam1"].project([p_first])[0] == pytest.approx(expected)


def test_numbers_as_yaml_cpp_writes_them_are_numbers(tmp_path: Path) -> None:
    """YAML 1.1 takes 1e-05 for text: it has no point."""
    text = KALIBR.replace("[-0.1, 0.02, 0.001, -0.002]", "[-0.1, 2e-2, 1e-05, -0.002]")
    assert load_calibration(write(tmp_path, text))["cam0"].distortion.tolist() == [-0.1, 0.02, 1e-5, -0.002, 0]


TOML = 'format = "rallyscope-calibration"\nversion = 1\n'
ONE = TOML + "[cameras.a]\nwidth_px = 10\nheight_px = 10\ndistortion = [0, 0, 0, 0, 0]\n"
POSE = "T_world_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
HUGE = "1" + 400 * "0"
BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 9)
)
"""A billion numbers in ten lines."""
PLAIN = "image_width: 4\nimage_height: 4\nD: [0, 0, 0, 0]\n"
BAD = {
    "bomb as a matrix": (BOMB + PLAIN + "K: *a8\n", "K"),
    "bomb as a size": (BOMB + "image_height: 4\nimage_width: *a8\n", "image_width"),
    "bomb as a model": (BOMB + "cam0:\n  camera_model: *a8\n", "unsupported camera model"),
    "matrix that holds itself": (PLAIN + "K: &k [*k]\n", "K"),
    "integer beyond floats": (PLAIN + f"K: [{HUGE}, 0, 0, 0, 1, 0, 0, 0, 1]\n", "K"),
    "integer beyond floats in ours": (ONE + POSE + f"K = [{HUGE}, 0, 0, 0, 1, 0, 0, 0, 1]\n", "K"),
    "size beyond floats": (f"image_width: {HUGE}\nimage_height: 4\n", "sensor size"),
    "nested too deep": (5000 * "[", "neither"),
    "nested too deep in ours": (TOML + "a = " + 5000 * "[", "TOML"),
    "tag that does not fit": (PLAIN + "K: !!bool perhaps\n", "K cannot be read"),
    "time that is none": (PLAIN + "K: !!timestamp soon\n", "K cannot be read"),
    "number of nothing": (PLAIN + "K: !!int ''\n", "K cannot be read"),
    "empty": ("", "table"),
    "prose": ("hello there", "table"),
    "unbalanced": ("a: [1, 2", "neither"),
    "nul": ("\x00\x01", "neither"),
    "other yaml": ("a: 1\n", "image_width"),
    "code": ('!!python/object/apply:os.system ["touch hacked"]', "neither"),
    "wrong version": (TOML.replace("1", "2"), "version 2"),
    "no cameras": (TOML, "cameras"),
    "no camera at all": (TOML + "[cameras]\n", "no camera"),
    "no K": (ONE + POSE, "'K'"),
    "K of text": (ONE + POSE + 'K = "big"\n', "K"),
    "K of wrong shape": (ONE + POSE + "K = [[1, 0], [0, 1]]\n", "wrong shape"),
    "K of infinity": (ONE + POSE + "K = [[inf, 0, 0], [0, 1, 0], [0, 0, 1]]\n", "finite"),
    "ragged K": (ONE + POSE + "K = [[1, 0, 0], [0, 1], [0, 0, 1]]\n", "K"),
    "negative focal length": (ONE + POSE + "K = [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]\n", "fx"),
    "squashed pose": (
        ONE + POSE.replace("[0, 1, 0, 0]", "[0, 2, 0, 0]") + "K = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        "rigid",
    ),
    "sensor of nothing": (ONE.replace("10", "0", 1) + POSE + "K = [1, 0, 0, 0, 1, 0, 0, 0, 1]", "sensor"),
    "sensor of text": (ONE.replace("10", '"x"', 1) + POSE, "width_px"),
    "broken toml": (TOML + "[cameras", "TOML"),
    "kalibr with another camera": (KALIBR.replace("pinhole", "omni"), "got omni"),
    "kalibr with another distortion": (KALIBR.replace("radtan", "fov"), "got fov"),
    "fisheye with two coefficients": (
        KALIBR.replace("radtan", "equidistant").replace("[0.0, 0.0, 0.0, 0.0]", "[0.1, 0.0]"),
        "number of distortion coefficients",
    ),
    "kalibr without chain": (KALIBR.replace("T_cn_cnm1", "T_cam_imu"), "T_cn_cnm1"),
    "kalibr with half a pixel": (KALIBR.replace("[1280, 720]", "[1280.5, 720]"), "resolution"),
    "kalibr with three intrinsics": (KALIBR.replace("1001.0, ", ""), "intrinsics"),
    "matrix that lies about its size": (
        "image_width: 4\nimage_height: 4\ncamera_matrix: !!opencv-matrix\n  rows: 9\n  cols: 3\n  dt: d\n  data: [1]\n",
        "opencv-matrix",
    ),
    "matrix that is none": (PLAIN + "camera_matrix: !!opencv-matrix 3\n", "opencv-matrix"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_gets_one_line_that_names_file_and_fault(tmp_path: Path, name: str) -> None:
    text, said = BAD[name]
    path = write(tmp_path, text)
    with pytest.raises(CalibrationError) as caught:
        load_calibration(path)
    message = str(caught.value)
    assert "calibration.yaml" in message and said in message and "\n" not in message
    assert len(message) < 600
    assert not Path("hacked").exists()


@pytest.mark.parametrize("count", [8, 12, 14])
def test_more_coefficients_are_those_of_opencv_and_zeros_at_the_end_say_nothing(tmp_path: Path, count: int) -> None:
    many = np.array([-0.1, 0.01, 0.001, 0.0, 0.002, 0.03, 0.02, 0.1, 0.01, 0.0, 0.0, 0.02, 0.03, -0.02])[:count]
    values: dict[str, int | np.ndarray] = {"image_width": 640, "image_height": 480, "camera_matrix": LEFT.K}
    camera = load_calibration(write_opencv(tmp_path / "a.yml", {**values, "distortion_coefficients": many[None]}))[
        "camera"
    ]
    np.testing.assert_array_equal(camera.distortion, many)
    ps = np.array([[0.3, -0.2, 1.0], [-0.5, 0.1, 1.5]])
    expected, _ = cv2.projectPoints(ps, np.zeros(3), np.zeros(3), LEFT.K, many)
    np.testing.assert_allclose(camera.project(ps), expected.reshape(-1, 2), atol=1e-9)
    many[5:] = 0.0
    camera = load_calibration(write_opencv(tmp_path / "b.yml", {**values, "distortion_coefficients": many[None]}))[
        "camera"
    ]
    np.testing.assert_array_equal(camera.distortion, many[:5])


def test_files_that_cannot_be_read_or_are_no_text_are_said_so(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot read"):
        load_calibration(tmp_path / "absent.toml")
    with pytest.raises(CalibrationError, match="cannot read"):
        load_calibration(tmp_path)
    binary = tmp_path / "picture.png"
    binary.write_bytes(bytes(range(256)))
    with pytest.raises(CalibrationError, match="not a text file"):
        load_calibration(binary)
    huge = tmp_path / "huge.yaml"
    huge.write_text("a" * (1 << 21))
    with pytest.raises(CalibrationError, match="too large"):
        load_calibration(huge)


def test_random_damage_never_ends_in_anything_but_a_calibration_or_its_error(tmp_path: Path) -> None:
    good = tmp_path / "good.toml"
    save_calibration(good, {"left": LEFT})
    rng = np.random.default_rng(0)
    for text in (good.read_text(), KALIBR):
        for _ in range(150):
            damaged = bytearray(text, "utf-8")
            for place in rng.integers(0, len(damaged), 3):
                damaged[place] = rng.integers(32, 127)
            path = write(tmp_path, damaged[: rng.integers(1, len(damaged) + 1)].decode())
            message = ""
            try:
                assert load_calibration(path)
            except CalibrationError as error:
                message = str(error)
            assert "\n" not in message


def test_saving_where_no_file_can_be_is_said_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibrationError, match="cannot write"):
        save_calibration(tmp_path / "file" / "rig.toml", CAMERAS)


def test_a_pose_in_the_world_is_the_left_cameras(tmp_path: Path) -> None:
    T = make_transform(np.eye(3), (1, 2, 3))
    path = write_opencv(
        tmp_path / "c.yml",
        {"image_width": 1280, "image_height": 720, "K": LEFT.K, "D": np.zeros((1, 4)), "T_world_camera": T},
    )
    assert load_calibration(path)["camera"].T_world_camera == pytest.approx(T)


def test_lists_of_up_to_64_rows_or_columns_are_read_and_no_longer_ones() -> None:
    for rows, columns in ((1, 64), (64, 2)):
        assert read_numbers(CalibrationNode({"K": [[1.0] * columns] * rows}, "a.yaml"), "K").size == rows * columns
    assert read_numbers(CalibrationNode({"K": [1.0] * 64}, "a.yaml"), "K").shape == (64,)
    for long in ([1.0] * 65, [[1.0] * 65], [[1.0]] * 65):
        with pytest.raises(CalibrationError):
            read_numbers(CalibrationNode({"K": long}, "a.yaml"), "K")
