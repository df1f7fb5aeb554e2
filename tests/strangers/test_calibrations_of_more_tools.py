"""More public reports about calibration files, each with a file made here: read right, or refused with the reason.

Each case says what came of it when it was first tried.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from core.cameras.calibration_file import read_calibration_file
from core.cameras.distortion import LensModel
from core.errors import CalibrationError

GITHUB = "https://github.com"
ROS = """image_width: 1920
image_height: 1200
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [1043.889715, 0.000000, 946.091722, 0.000000, 1045.536555, 601.201155, 0.000000, 0.000000, 1.000000]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.034062 0.026819 0.000826 -0.002720 0.000000]
"""
INI = """[image]

width
{width}

height
{height}

[narrow_stereo]

camera matrix
1000.500000 0.000000 {cx}
0.000000 1001.000000 200.250000
0.000000 0.000000 1.000000

distortion
{distortion}

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000
"""
FIVE, EIGHT = "-0.011282 0.005934 -0.000430 -0.001142 0.000000", "0.1895 -0.0182 -0.0006 5.4e-05 -0.0002 0.5 -0.02 0.0"
PRINTED = (
    "D = [-0.011282, 0.005934, -0.00043, -0.001142, 0.0]\nK = [1000.5, 0.0, 640.0, 0.0, 1001.0, 200.25, 0, 0, 1]\n"
)
OMNI = """camera_center:
  camera_model: omni
  distortion_coeffs: [-0.0575, 0.1968, -0.0017, 0.0013]
  distortion_model: radtan
  intrinsics: [1.7769, 2190.9, 2183.3, 1215.7, 1042.6]
  resolution: [2448, 2048]
  rostopic: /camera_center
"""
NAMED = OMNI.replace("omni", "pinhole").replace("1.7769, ", "")
VINS = "%YAML:1.0\n---\nmodel_type: {model}\ncamera_name: camera\nimage_width: 752\nimage_height: 480\n"
DISTORTION = "distortion_parameters:\n   k1: -2.95e-01\n   k2: 8.66e-02\n   p1: 2.01e-04\n   p2: 1.39e-05\n"
PROJECTION = "projection_parameters:\n   fx: 461.15\n   fy: 459.75\n   cx: 362.5\n   cy: 248.5\n"
KANNALA = (
    "projection_parameters:\n   k2: -0.01\n   k3: 0.02\n   k4: -0.03\n   k5: 0.004\n   mu: 461.15\n   mv: 459.75\n"
)
EUROC = """sensor_type: camera
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
"""
DAVIS = """image_width: 346
image_height: 260
camera_name: DAVIS
camera_matrix:
  rows: 3
  cols: 3
  data: [274.6631, 0, 168.47, 0, 274.59, 141.8423, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.4043, 0.2296, 0.0003377, 0.000391, -0.080294]
projection_matrix:
  rows: 3
  cols: 4
  data: [1, 0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 0]
"""
QUALISYS = """[cam_01]
name = "cam_01"
size = [ 1088.0, 1920.0]
matrix = [ [ 1681.25, 0.0, 532.97369384375], [ 0.0, 1681.07, 948.137390140625], [ 0.0, 0.0, 1.0]]
distortions = [ -0.000721609375, 0.002187234375, 9.5e-06, 1.078125e-05]
rotation = [ 1.6882754799999993, 1.0483220499999997, -0.41955852000000016]
translation = [ 0.3211048899999996, 0.9563320600000009, 2.8907130499999996]
fisheye = false
"""
ORB = (
    '%YAML:1.0\n\nFile.version: "1.0"\nCamera.type: "PinHole"\nCamera1.fx: 517.306408\nCamera1.fy: 516.469215\n'
    "Camera1.cx: 318.643040\nCamera1.cy: 255.313989\nCamera.width: 640\nCamera.height: 480\n"
)
IKALIBR = """Intrinsics:
  polymorphic_name: pinhole_brown_t2
  ptr_wrapper:
    data:
      img_width: 1376
      img_height: 1100
      focal_length: [909.668, 909.494]
"""
MC_CALIB = """%YAML:1.0
---
nb_camera: 2
camera_0:
   camera_matrix: !!opencv-matrix
      rows: 3
      cols: 3
      dt: d
      data: [ 1000., 0., 640., 0., 1000., 360., 0., 0., 1. ]
   img_width: 1280
   img_height: 720
"""
REPORT = """Calibration results
====================
Camera-system parameters:
cam0 (/cam0/image_raw):
    distortion: [-0.28  0.07  0.0001  0.00001] +- [0.0 0.0 0.0 0.0]
"""

Lens = tuple[str, LensModel, tuple[int, int], tuple[float, ...], tuple[float, ...]]
READ: dict[str, tuple[str, Lens]] = {
    # The list of coefficients has no commas: was refused, "1 x 5 with 1 numbers".
    f"{GITHUB}/ros-perception/image_pipeline/issues/533": (
        ROS,
        ("camera", "pinhole", (1920, 1200), (1043.889715, 946.091722), (-0.034062, 0.026819, 0.000826, -0.00272, 0)),
    ),
    # What camera_calibration prints, saved as it stands: was refused, "not a TOML file".
    f"{GITHUB}/TheImagingSource/tiscamera/issues/280": (
        PRINTED + "# oST version 5.0 parameters\n\n" + INI.format(width=1280, height=720, cx=640.0, distortion=FIVE),
        ("camera", "pinhole", (1280, 720), (1000.5, 640.0), (-0.011282, 0.005934, -0.00043, -0.001142, 0)),
    ),
    # An INI of ROS with eight coefficients: was refused, "not a TOML file".
    f"{GITHUB}/ros-perception/image_common/issues/33": (
        INI.format(width=640, height=480, cx=320.7, distortion=EIGHT),
        ("camera", "pinhole", (640, 480), (1000.5, 320.7), (0.1895, -0.0182, -0.0006, 5.4e-05, -0.0002, 0.5, -0.02, 0)),
    ),
    # Kalibr's keys under another name than cam0: was refused, "does not say for which picture size".
    f"{GITHUB}/ethz-asl/image_undistort/issues/72": (
        NAMED,
        ("camera_center", "pinhole", (2448, 2048), (2190.9, 1215.7), (-0.0575, 0.1968, -0.0017, 0.0013, 0)),
    ),
    # camodocal's pinhole: was refused, "incomplete".
    f"{GITHUB}/HKUST-Aerial-Robotics/VINS-Fusion/issues/29": (
        VINS.format(model="PINHOLE") + DISTORTION + PROJECTION,
        ("camera", "pinhole", (752, 480), (461.15, 362.5), (-0.295, 0.0866, 0.000201, 0.0000139, 0)),
    ),
    # Its fisheye lens: was refused, "incomplete".
    "own variation: KANNALA_BRANDT": (
        VINS.format(model="KANNALA_BRANDT") + KANNALA + "   u0: 362.5\n   v0: 248.5\n",
        ("camera", "fisheye", (752, 480), (461.15, 362.5), (-0.01, 0.02, -0.03, 0.004)),
    ),
    # EuRoC's own names: was right.
    f"{GITHUB}/HKUST-Aerial-Robotics/VINS-Mono/issues/206": (
        EUROC,
        ("camera", "pinhole", (752, 480), (458.654, 367.215), (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0)),
    ),
    # A projection matrix that is none, which is not needed: was right.
    f"{GITHUB}/uzh-rpg/rpg_dvs_ros/issues/130": (
        DAVIS,
        ("camera", "pinhole", (346, 260), (274.6631, 168.47), (-0.4043, 0.2296, 0.0003377, 0.000391, -0.080294)),
    ),
    # A portrait camera whose size has fractions of zero: was right.
    f"{GITHUB}/perfanalytics/pose2sim/issues/98": (
        QUALISYS,
        ("cam_01", "pinhole", (1088, 1920), (1681.25, 532.97369384375), (-0.0007216, 0.0021872, 9.5e-06, 1.078e-05, 0)),
    ),
}

PAIR_R = [[0.98, 0.0, 0.198997], [0.0, 1.0, 0.0], [-0.198997, 0.0, 0.98]]


def message(cx: float, R: list[list[float]] | None = None, shift: float = 0.0) -> dict[str, object]:
    """A CameraInfo of ROS as JSON."""
    P = [600, 0, cx, shift, 0, 600, 240, 0, 0, 0, 1, 0]
    flat = [number for row in R or np.eye(3).tolist() for number in row]
    K = [600, 0, cx, 0, 600, 240, 0, 0, 1]
    return {"width": 640, "height": 480, "distortion_model": "plumb_bob", "D": [0.1] * 5, "K": K, "R": flat, "P": P}


PAIRS: dict[str, tuple[dict[str, object], list[str], list[float]]] = {
    # By R and P of a rectified pair, 0.5 m apart: were refused, "no camera matrix that is known".
    "messages": ({"left": message(300), "right": message(310, shift=-300)}, ["left", "right"], [0.5, 0, 0]),
    "messages, the right one first": (
        {"right": message(310, shift=-300), "left": message(300)},
        ["left", "right"],
        [0.5, 0, 0],
    ),
    "topics, turned": (
        {"/cam0/camera_info": message(300, PAIR_R), "/cam1/camera_info": message(310, PAIR_R, -300)},
        ["cam0", "cam1"],
        [0.49, 0, 0.0995],
    ),
    # R and T beside the cameras, which go from left to right as OpenCV's.
    "cameras beside R and T": (
        {"right": message(310), "left": message(300), "R": np.eye(3).tolist(), "T": [-0.4, 0, 0]},
        ["left", "right"],
        [0.4, 0, 0],
    ),
}


@pytest.mark.parametrize("form", PAIRS)
def test_two_cameras_in_tables_of_their_own_are_read_with_their_poses(form: str, tmp_path: Path) -> None:
    tree, names, place_m = PAIRS[form]
    (tmp_path / "a.json").write_text(json.dumps(tree))
    cameras = read_calibration_file(tmp_path / "a.json").cameras
    assert list(cameras) == names
    first, second = cameras.values()
    assert (first.K[0, 2], second.K[0, 2]) == (300, 310)
    assert second.position_world_m == pytest.approx(place_m, abs=1e-3) and not first.position_world_m.any()


REFUSED = {
    # Cameras in tables of their own without poses: were refused, "no camera matrix that is known".
    "own variation: messages of two cameras that are not rectified": (
        json.dumps({"left": message(300), "right": message(310)}),
        "does not say how left, right stand to each other",
    ),
    # Pictures with row 0 at the bottom: was read as any other.
    "own variation: an origin at the bottom": (
        json.dumps({**message(300), "image_origin": "bottom_left"}),
        "rows are counted from the bottom.*got image_origin: 'bottom_left'",
    ),
    # An omnidirectional camera: was refused, "does not say for which picture size".
    f"{GITHUB}/ethz-asl/image_undistort/issues/75": (OMNI, "unsupported camera model.*got omni"),
    # camodocal's Mei: was refused, "incomplete".
    "own variation: MEI": (VINS.format(model="MEI") + DISTORTION + PROJECTION, "unsupported.*model_type 'MEI'"),
    # Kalibr's keys under several other names: was refused, "does not say for which picture size".
    "own variation: two names": (NAMED + NAMED.replace("center", "left"), "expected cam0, cam1, got camera_center"),
    # Files of other tools whose size stands elsewhere: were refused, "does not say for which picture size".
    f"{GITHUB}/ethz-asl/kalibr/issues/569": (ORB, "no camera matrix that is known.*Camera1.fx"),
    f"{GITHUB}/Unsigned-Long/iKalibr/issues/38": (IKALIBR, "no camera matrix that is known.*the keys Intrinsics"),
    f"{GITHUB}/rameau-fr/MC-Calib/issues/56": (MC_CALIB, "no camera matrix that is known.*nb_camera, camera_0"),
    # The report of Kalibr: was refused, "neither TOML nor YAML".
    "own variation: results-cam.txt": (REPORT, "Kalibr's report.*camchain"),
    # Tools that are recognised and not read: were refused as "not a TOML file", "not a table", "no list of numbers".
    "own variation: Calib_Results.m": (
        "% Intrinsic and Extrinsic Camera Parameters\n%\n\n%-- Focal length:\nfc = [ 657.3 ; 657.7 ];\n",
        "Camera Calibration Toolbox for MATLAB, which is not read; write image_width",
    ),
    "own variation: cameras.txt of COLMAP": (
        "# Camera list with one line of data per camera:\n1 OPENCV 640 480 520 520 320 240 0 0 0 0\n",
        "COLMAP's list of cameras, which is not read; write image_width",
    ),
    "own variation: Basalt": (
        json.dumps({"value0": {"T_imu_cam": [], "intrinsics": [], "resolution": []}}),
        "a calibration of Basalt, which is not read; write image_width",
    ),
    # Two cameras in one INI: was refused, "not a TOML file".
    "own variation: two cameras": (
        INI.format(width=640, height=480, cx=320, distortion=FIVE) * 2,
        "ROS's INI is of one camera; got 2",
    ),
}


@pytest.mark.parametrize("link", READ)
def test_a_calibration_that_others_misread_is_read(link: str, tmp_path: Path) -> None:
    text, (name, model, size, (fx, cx), distortion) = READ[link]
    (tmp_path / "a.yaml").write_text(text)
    ((found, camera),) = read_calibration_file(tmp_path / "a.yaml").cameras.items()
    assert (found, camera.model, camera.sensor.width_px, camera.sensor.height_px) == (name, model, *size)
    assert (camera.K[0, 0], camera.K[0, 2]) == pytest.approx((fx, cx))
    assert camera.distortion == pytest.approx(distortion, rel=1e-3)


@pytest.mark.parametrize("link", REFUSED)
def test_a_calibration_that_cannot_be_read_is_refused_with_the_cause(link: str, tmp_path: Path) -> None:
    text, said = REFUSED[link]
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(CalibrationError, match=said):
        read_calibration_file(tmp_path / "a.yaml")


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_of_numpy_are_refused_as_such(save: Callable[..., None], tmp_path: Path) -> None:
    """OpenCV's tutorial keeps a calibration so; it was refused as a compressed file that is to be unpacked."""
    with (tmp_path / "lens.npz").open("wb") as file:
        save(file, mtx=np.eye(3), dist=np.zeros(5))
    with pytest.raises(CalibrationError, match=r"arrays of NumPy.*as JSON or YAML"):
        read_calibration_file(tmp_path / "lens.npz")
