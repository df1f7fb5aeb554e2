"""Public reports about calibrations, their units, environments and flights: each tried, with an input of our own.

Each case says whether it was wrong here before it was tried.
"""

from __future__ import annotations

import os
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from app.cli import main
from core.cameras.calibration_file import read_calibration_file
from core.errors import AgentError, CalibrationError
from core.learning.gym_environment import RETURN_ID
from core.physics.points_file import PointsFileError, read_points_file
from core.recordings import open_recording

CAMERA_INFO = "height: {h}\nwidth: {w}\ndistortion_model: {model}\nd: {d}\nk: {k}\nbinning_x: {bin}\nbinning_y: {bin}\n"
ONE = "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"


def info(
    k: list[float], d: list[float], model: str = "plumb_bob", size: tuple[int, int] = (1280, 800), binning: int = 0
) -> str:
    return CAMERA_INFO.format(h=size[1], w=size[0], model=model, d=d, k=k, bin=binning)


def kalibr(second: str, model: str = "pinhole") -> str:
    lens = (
        f"  camera_model: {model}\n  distortion_model: radtan\n  distortion_coeffs: [-0.1, 0.01, 0, 0]\n"
        "  intrinsics: [460, 460, 370, 240]\n  resolution: [752, 480]\n"
    )
    return f"cam0:\n{lens}cam1:\n{lens}  T_cn_cnm1: {second}\n"


def shifted(x: float) -> str:
    return f"[[1, 0, 0, {x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"


def stereo(T: str, more: str = "") -> str:
    K = "[[400, 0, 320], [0, 400, 240], [0, 0, 1]]"
    text = f"image_width: 640\nimage_height: 480\nM1: {K}\nM2: {K}\nD1: [0, 0, 0, 0, 0]\nD2: [0, 0, 0, 0, 0]\n"
    return f"{text}R: {ONE}\nT: {T}\n{more}"


MATRIX = "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
MATRIX += "   data: [ 545., 0., 339., 0.,\n       541., 181., 0., 0., 1. ]\n"

REFUSED = {
    # A baseline of 60 mm given as 60: was refused already.
    "https://github.com/dilipkumar25/see3cam/issues/9": (stereo("[-60.0, 0, 0]"), r"0\.06 m \(millimetres"),
    # Kalibr's unit is that of the target: was refused beyond 12 m already.
    "https://github.com/ethz-asl/kalibr/issues/664": (kalibr(shifted(-110)), r"0\.11 m \(millimetres"),
    # Squares of the board as unit: was wrong, 8 squares were 8 m.
    "https://github.com/puzzlepaint/camera_calibration/issues/10": (
        stereo("[-8, 0, 0]", "square_size: 13.\n"),
        "squares of 13 m",
    ),
    # K of binned pictures with the size of the sensor: was wrong, read as it stands.
    "https://github.com/astuff/avt_vimba_camera/issues/82": (
        info([299.5, 0, 254.1, 0, 300.1, 183.9, 0, 0, 1], [-0.1, 0.08, 0, 0, 0], size=(2064, 1544), binning=4),
        "binned",
    ),
    # K scaled by a wrong factor: was wrong, read as it stands.
    "https://github.com/orbbec/OrbbecSDK_ROS1/issues/7": (
        info([13489.9, 0, 11447.9, 0, 13487.8, 6276.5, 0, 0, 1], [0] * 5, size=(3840, 2160)),
        "principal point is outside",
    ),
    # A skew in K, of a fisheye lens: was refused already, OpenCV's models have none.
    "https://github.com/ika-rwth-aachen/ros2_calib/issues/6": (
        info([1133, 4.26, 960, 0, 1128, 600, 0, 0, 1], [-0.1, 0.2, -0.2, 0.1], "equidistant", (1920, 1200)),
        "skew",
    ),
    # A double-sphere lens: was refused by name already.
    "https://github.com/ethz-asl/kalibr/issues/596": (kalibr(shifted(-0.15), "ds"), "got ds"),
    # A calibration is for one resolution, which this file does not say: was refused with three names of keys.
    "https://github.com/RealOrangeOne/zoloto/pull/292": (
        f"camera_matrix: {ONE}\ndistortion_coefficients: [0, 0, 0, 0, 0]\n",
        "add image_width and image_height",
    ),
}

NOTED = {
    # A right camera on the left of the left one: was wrong, read without a word.
    "https://github.com/realsenseai/realsense-ros/issues/1310": (stereo("[0.0499, 0, 0]"), "to the left of left"),
    # Pixels that are not square, by a calibration that did not converge: was read without a word.
    "https://github.com/ros-perception/image_pipeline/issues/840": (
        info([403.7, 0, 337.6, 0, 539.7, 230.0, 0, 0, 1], [-0.05, 0.01, 0, 0, 0], size=(640, 480)),
        "fx 403.7 and fy 539.7 differ",
    ),
    # Which way T_cn_cnm1 goes is fixed, but where the table is, is not said: was read without a word.
    "https://github.com/ethz-asl/kalibr/issues/207": (kalibr(shifted(-0.11)), "the world is the frame of cam0"),
}


@pytest.mark.parametrize("link", REFUSED)
def test_a_calibration_that_misled_somebody_is_refused_with_the_reason(tmp_path: Path, link: str) -> None:
    text, said = REFUSED[link]
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(CalibrationError, match=said):
        read_calibration_file(tmp_path / "a.yaml")


@pytest.mark.parametrize("link", NOTED)
def test_a_calibration_that_misled_somebody_is_read_with_a_remark(tmp_path: Path, link: str) -> None:
    text, said = NOTED[link]
    (tmp_path / "a.yaml").write_text(text)
    assert said in "; ".join(read_calibration_file(tmp_path / "a.yaml").notes)


READ = {
    # Eight numbers of which three are 0, called plumb_bob: was right.
    "https://github.com/orbbec/OrbbecSDK_ROS2/issues/216": (
        info([700, 0, 640, 0, 700, 400, 0, 0, 1], [-0.03, 0.04, -0.0001, -0.0001, -0.01, 0, 0, 0]),
        [-0.03, 0.04, -0.0001, -0.0001, -0.01],
    ),
    # OpenCV's own sample of 2.4, without ---, and with squares of 1 for a single lens: was right.
    "https://github.com/ros-perception/image_common/issues/27": (
        '%YAML:1.0\ncalibration_time: "Mon Oct 27 20:27:45 2014"\nimage_width: 640\nimage_height: 360\n'
        f"square_size: 1.\nflags: 0\ncamera_matrix: {MATRIX}"
        "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
        "   data: [ -5.3e-01, 3.6e-01,\n       1.4e-03, -3.3e-03, -1.2e-01 ]\n",
        [-0.53, 0.36, 0.0014, -0.0033, -0.12],
    ),
    # Whole numbers in a matrix of doubles, which OpenCV 4.11 garbles: was right.
    "https://github.com/opencv/opencv-python/issues/1078": (
        "%YAML:1.0\nimage_width: 640\nimage_height: 360\ncamera_matrix:\n  rows: 3\n  cols: 3\n  dt: d\n"
        "  data: [ 545, 0, 339, 0.0, 541, 181, 0, 0, 1 ]\ndistortion_coefficients: [ 0, 0.0, 0, 0, 0 ]\n",
        [0, 0, 0, 0, 0],
    ),
}


@pytest.mark.parametrize("link", READ)
def test_a_calibration_that_another_tool_cannot_read_is_read(tmp_path: Path, link: str) -> None:
    text, expected = READ[link]
    (tmp_path / "a.yml").write_text(text)
    (camera,) = read_calibration_file(tmp_path / "a.yml").cameras.values()
    assert camera.distortion == pytest.approx(expected) and camera.K[0, 0] in (545, 700)


def flight(t: np.ndarray, header: str, unit: float) -> str:
    ps = np.column_stack([1.3 - 5 * t, 0.1 + 0 * t, 0.6 + 1.5 * t - 4.905 * t**2])
    return (
        header + "\n" + "\n".join(f"{unit * a:.9g},{x:.9g},{y:.9g},{z:.9g}" for a, (x, y, z) in zip(t, ps, strict=True))
    )


def test_seconds_in_a_column_called_msec_are_refused(tmp_path: Path) -> None:
    """https://github.com/swift-nav/piksi_tools/issues/629: was wrong, predicted without a word."""
    (tmp_path / "a.csv").write_text(flight(np.arange(60) / 120, "t_ms,x_m,y_m,z_m", 1.0))
    with pytest.raises(PointsFileError, match="times multiplied by 1000"):
        read_points_file(tmp_path / "a.csv")


def test_seconds_in_a_column_called_ns_are_refused(tmp_path: Path) -> None:
    """https://github.com/waterloo-rocketry/omnibus/issues/540: was refused as times that do not ascend."""
    (tmp_path / "a.csv").write_text(flight(np.arange(60) / 120, "t_ns,x_m,y_m,z_m", 1.0))
    with pytest.raises(PointsFileError, match="no ball flies so"):
        read_points_file(tmp_path / "a.csv")


def test_times_whose_unit_depends_on_the_maker_are_told_by_the_flight(tmp_path: Path) -> None:
    """https://github.com/microsoft/LabanotationSuite/issues/9: the columns were refused."""
    for unit, name in ((1e3, "times in ms"), (1e9, "times in ns")):
        (tmp_path / "a.csv").write_text(flight(np.arange(60) / 120, "timestamp,x,y,z", unit))
        found = read_points_file(tmp_path / "a.csv")
        assert name in found.notes[0] and found.t_s[-1] == pytest.approx(59 / 120)


def test_a_checker_that_steps_once_is_content_and_a_second_step_is_refused() -> None:
    """https://github.com/openai/gym/issues/2803, DLR-RM/stable-baselines3/pull/1524: a second step was played."""
    environment = gymnasium.make(RETURN_ID).unwrapped
    check_env(environment)
    environment.reset(seed=0)
    environment.step(np.zeros(3, np.float32))
    with pytest.raises(ResetNeeded):
        environment.step(np.zeros(3, np.float32))


def test_an_action_of_nan_is_no_missed_ball() -> None:
    """https://github.com/openai/gym/pull/2804 (checks of NaN in environments): was counted as a miss."""
    environment = gymnasium.make(RETURN_ID).unwrapped
    environment.reset(seed=0)
    with pytest.raises(AgentError, match="no number"):
        environment.step(np.full(3, np.nan, np.float32))


def test_a_vectorised_episode_serves_no_ball_twice() -> None:
    """https://github.com/huggingface/lerobot/pull/4242 (a reset more skips a state): was right in separate copies."""
    copies = gymnasium.make_vec(RETURN_ID, num_envs=4)
    seen = [copies.reset(seed=0)[0]]
    for _ in range(6):
        seen.append(copies.step(np.zeros((4, 3), np.float32))[0])
    rows = np.concatenate(seen)
    assert len(np.unique(rows, axis=0)) == len(rows)


def test_a_calibration_whose_name_is_no_text_is_kept_with_its_remark(tmp_path: Path) -> None:
    """https://github.com/rsnitsch/py3createtorrent/issues/33 (names that are no text): was an error of the codec."""
    lens = tmp_path / os.fsdecode(b"\xfflens.yml")
    K = "[[1000, 0, 640], [0, 1000, 360], [0, 0, 1]]"
    lens.write_text(
        f"image_width: 1280\nimage_height: 720\ncamera_matrix: {K}\ndistortion_coefficients: [0.1, 0.01, 0, 0]\n"
    )
    np.savez(tmp_path / "a.npz", t=np.array([0, 5]), x=np.array([1, 2]), y=np.array([3, 4]), p=np.array([0, 1]))
    words = ["--width", "1280", "--height", "720", "--calibration", str(lens), "--time-unit", "us"]
    assert main(["import", str(tmp_path / "a.npz"), str(tmp_path / "a.h5"), *words]) == 0
    with open_recording(tmp_path / "a.h5") as recording:
        assert "names no lens model" in " ".join(recording.notes)


ANIPOSE = """
[cam_0]
name = "left"
size = [1280, 720]
matrix = [[1000.0, 0.0, 640.0], [0.0, 1000.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.3, 0.1, 0.001, 0.001, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.0]

[cam_1]
size = [1280, 720]
matrix = [[900.0, 0.0, 640.0], [0.0, 900.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [0.1, 0.01, 0.0, 0.0]
fisheye = true
rotation = [0.0, 1.5707963267948966, 0.0]
translation = [-0.5, 0.0, 0.2]

[metadata]
error = 0.35
"""


def test_the_toml_of_anipose_is_read_with_its_poses_from_world_to_camera(tmp_path: Path) -> None:
    """https://github.com/lambdaloop/anipose/issues/17, perfanalytics/pose2sim/issues/136: "neither TOML nor YAML"."""
    (tmp_path / "calibration.toml").write_text(ANIPOSE)
    cameras = read_calibration_file(tmp_path / "calibration.toml").cameras
    assert [*cameras] == ["left", "cam_1"] and cameras["cam_1"].model == "fisheye"
    np.testing.assert_array_equal(cameras["left"].distortion, [-0.3, 0.1, 0.001, 0.001, 0.0])
    # A quarter turn about y: the camera's z is the world's -x. C = -R^T t.
    np.testing.assert_allclose(cameras["cam_1"].T_world_camera[:3, 2], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(cameras["cam_1"].position_world_m, [0.2, 0, 0.5], atol=1e-12)


def test_the_toml_of_anipose_with_matrices_below_cameras_and_in_millimetres(tmp_path: Path) -> None:
    """Variation: Caliscope's newer form."""
    text = ANIPOSE.replace("[cam_", "[cameras.").replace("= [0.0, 0.0, 0.0]\ntr", f"= {ONE}\ntr")
    text = 'unit = "mm"\n' + text.replace("-0.5, 0.0, 0.2", "-500.0, 0.0, 200.0")
    (tmp_path / "a.toml").write_text(text)
    cameras = read_calibration_file(tmp_path / "a.toml").cameras
    np.testing.assert_allclose(cameras["1"].position_world_m, [0.2, 0, 0.5], atol=1e-12)


OTHER_TOML = "[camera]\nfocal = 3\n"
LENS = f"image_width: 640\nimage_height: 480\ncamera_matrix: {[[400, 0, 320], [0, 400, 240], [0, 0, 1]]}\n"
FOUR = "distortion_coefficients: [-0.1, 0.01, 0.001, 0.001]\n"


@pytest.mark.parametrize("key", ["calibration_type", "projection", "lens", "Projection-Model", "model", "camera_model"])
def test_a_lens_model_counts_whatever_its_key_is_called(tmp_path: Path, key: str) -> None:
    (tmp_path / "a.yml").write_text(f"{LENS}{FOUR}{key}: fisheye\n")
    found = read_calibration_file(tmp_path / "a.yml")
    assert found.cameras["camera"].model == "fisheye" and not found.notes


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("model: omnidir\n", "unsupported lens model.*omnidir"),
        ("type: MEI\n", "unsupported lens model.*MEI"),
        ("xi: 1.2\n", "unsupported lens model.*xi 1.2"),
        ("mirror_parameters: {xi: 0.9}\n", "unsupported lens model.*xi 0.9"),
        ("distortion: {model: double_sphere}\n", "unsupported lens model.*double_sphere"),
        ("lens: hyperbolic\n", "unsupported lens model.*hyperbolic"),
        ("units: inch\n", "units: another unit; expected m, cm or mm.*inch"),
    ],
)
def test_a_model_or_a_unit_that_is_not_known_is_refused_by_its_name(tmp_path: Path, lines: str, said: str) -> None:
    (tmp_path / "a.yml").write_text(f"{LENS}{FOUR}{lines}")
    with pytest.raises(CalibrationError, match=said):
        read_calibration_file(tmp_path / "a.yml")


def test_the_name_of_the_camera_is_no_lens_model(tmp_path: Path) -> None:
    (tmp_path / "a.yml").write_text(f"{LENS}{FOUR}model: DAVIS346\ntype: event\ncamera_name: mei\n")
    assert read_calibration_file(tmp_path / "a.yml").cameras["camera"].model == "pinhole"


@pytest.mark.parametrize("tag", ["!Camera", "!!python/object:rig.Camera", "!!map"])
def test_a_tag_that_nobody_needs_does_not_refuse_a_file(tmp_path: Path, tag: str) -> None:
    lens = "".join(f"  {line}\n" for line in f"{LENS}{FOUR}distortion_model: plumb_bob".splitlines())
    (tmp_path / "a.yml").write_text(f"--- {tag}\n{lens}  extra: !!python/tuple [1, 2]\n")
    found = read_calibration_file(tmp_path / "a.yml").cameras["camera"].distortion
    np.testing.assert_array_equal(found[:4], [-0.1, 0.01, 0.001, 0.001])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\x1f\x8b\x08\x00" + bytes(30), "compressed .gzip."),
        (OTHER_TOML.encode(), "does not say for which picture size"),
        (b"[cam]\nK = [1, 2\n", "not a TOML file"),
    ],
)
def test_the_reason_is_that_of_the_form_that_the_file_has(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "a.yml").write_bytes(content)
    with pytest.raises(CalibrationError, match=said):
        read_calibration_file(tmp_path / "a.yml")
