"""Calibration files as the tools of the field write them: read by value, or refused by name."""

from __future__ import annotations

import codecs
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.cameras import Camera, load_calibration
from core.cameras.calibration_file import CalibrationFile, read_calibration_file
from core.errors import CalibrationError

pytestmark = pytest.mark.numeric
MATRIX = """camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1000., 0., 640., 0., 990., 360., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: {rows}
   cols: 1
   dt: d
   data: [ {data} ]
"""
SIZE = "image_width: 1280\nimage_height: 720\n"
FIVE = MATRIX.format(rows=5, data="-0.3, 0.1, 0.001, 0.002, 0.")
FOUR = MATRIX.format(rows=4, data="0.05, -0.01, 0.002, -0.001")
HEAD = "%YAML:1.0\n---\n"
NESTED = "a: !!opencv-nd-matrix\n   sizes: [ 1, 2, 2 ]\n   dt: d\n   data: [1,2,3,4]\n"
FAR = "T_world_camera: [1,0,0,-1150, 0,1,0,1750, 0,0,1,1150, 0,0,0,1]\n"
POINTS = """image_points: !!opencv-matrix
   rows: 2
   cols: 3
   dt: "2f"
   data: [ 0., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11. ]
"""
ODD = {
    "points of two channels": HEAD + SIZE + POINTS + FIVE,
    "an empty matrix": HEAD + SIZE + "a: !!opencv-matrix\n   rows: 0\n   cols: 0\n   dt: d\n   data: [ ]\n" + FIVE,
    "an n-d matrix": HEAD
    + SIZE
    + "a: !!opencv-nd-matrix\n   sizes: [ 1, 2, 2 ]\n   dt: d\n   data: [1,2,3,4]\n"
    + FIVE,
    "a tag of its own": HEAD + SIZE + "a: !!opencv-sparse-matrix\n   sizes: [ 1 ]\n" + FIVE,
    "a time that is none": HEAD + SIZE + "calibration_time: 2024-13-45\n" + FIVE,
    "values that are not numbers": HEAD + SIZE + "errors: [ .Nan, .Inf, nan ]\n" + FIVE,
    "comments first": "# the left camera\n\n# of Monday\n" + HEAD + SIZE + FIVE,
    "another version": "%YAML 1.2\n---\n" + SIZE + FIVE + "...\n",
    "a mark and other line ends": "\ufeff" + (HEAD + SIZE + FIVE).replace("\n", "\r\n"),
    "a second document": SIZE + FIVE + "---\n",
    "names of old samples": HEAD
    + (SIZE + FIVE)
    .replace("image_w", "image_W")
    .replace("camera_matrix", "Camera_Matrix")
    .replace("distortion_coefficients", "Distortion_Coefficients"),
    "names in one word": HEAD
    + (SIZE + FIVE).replace("camera_matrix", "cameraMatrix").replace("image_width", "imageWidth"),
    "a size in one": HEAD + "image_size: [ 1280, 720 ]\n" + FIVE,
}


def write(tmp_path: Path, text: str | bytes, name: str = "lens.yml") -> Path:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def check(camera: Camera) -> None:
    assert str(camera.sensor) == "1280x720" and camera.model == "pinhole"
    assert camera.K.tolist() == [[1000, 0, 640], [0, 990, 360], [0, 0, 1]]
    assert camera.distortion.tolist() == [-0.3, 0.1, 0.001, 0.002, 0]


@pytest.mark.parametrize("name", ODD)
def test_what_nobody_asks_for_does_not_decide_whether_a_lens_is_read(tmp_path: Path, name: str) -> None:
    check(load_calibration(write(tmp_path, ODD[name]))["camera"])


def test_texts_of_windows_editors_are_read(tmp_path: Path) -> None:
    text = "# Kamera für links\n" + HEAD + SIZE + FIVE
    check(load_calibration(write(tmp_path, text.encode("latin-1")))["camera"])
    check(load_calibration(write(tmp_path, text.encode("utf-16")))["camera"])
    ours = 'format = "rallyscope-calibration"\nversion = 1\n[cameras.a]\nwidth_px = 1280\nheight_px = 720\n'
    ours += "K = [[1000, 0, 640], [0, 990, 360], [0, 0, 1]]\ndistortion = [-0.3, 0.1, 0.001, 0.002, 0]\n"
    ours += "T_world_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
    check(load_calibration(write(tmp_path, codecs.BOM_UTF8 + ours.encode()))["a"])


@pytest.mark.parametrize("suffix", [".xml", ".json", ".yml"])
def test_opencvs_three_forms_are_read_alike(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"out_camera_data{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon 01 Jan")
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("camera_matrix", np.array([[1000.0, 0, 640], [0, 990, 360], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([[-0.3, 0.1, 0.001, 0.002, 0.0]]).T)
    storage.write("image_points", np.zeros((2, 3, 2), np.float32))
    storage.release()
    check(load_calibration(path)["camera"])


def test_xml_that_is_not_opencvs_or_defines_entities_is_refused(tmp_path: Path) -> None:
    for text in ('<!DOCTYPE a [<!ENTITY x "y">]><opencv_storage/>', "<a/>", "<opencv_storage>"):
        with pytest.raises(CalibrationError, match=r"lens\.xml: not"):
            load_calibration(write(tmp_path, text, "lens.xml"))


ROS = """image_width: 1280
image_height: 720
camera_name: left
camera_matrix:
  rows: 3
  cols: 3
  data: [1000.0, 0.0, 640.0, 0.0, 990.0, 360.0, 0.0, 0.0, 1.0]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {count}
  data: {data}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [1000, 0, 640, 0, 0, 990, 360, 0, 0, 0, 1, 0]}}
"""


@pytest.mark.parametrize(
    ("model", "data", "expected"),
    [
        ("plumb_bob", [-0.3, 0.1, 0.001, 0.002, 0.0], ("pinhole", [-0.3, 0.1, 0.001, 0.002, 0.0])),
        ("equidistant", [0.05, -0.01, 0.002, -0.001], ("fisheye", [0.05, -0.01, 0.002, -0.001])),
        ("fisheye", [0.05, -0.01, 0.002, -0.001, 0.0], ("fisheye", [0.05, -0.01, 0.002, -0.001])),
        ("rational_polynomial", [0.1] * 8, ("pinhole", [0.1] * 8)),
        ("inverse_brown_conrady", [0.0] * 5, ("pinhole", [0.0] * 5)),
    ],
)
def test_ros_camera_info_is_read_by_its_distortion_model(tmp_path: Path, model, data, expected) -> None:
    camera = load_calibration(write(tmp_path, ROS.format(model=model, count=len(data), data=data)))["camera"]
    assert (camera.model, camera.distortion.tolist()) == expected
    assert camera.K[1, 1] == 990


@pytest.mark.parametrize("keys", ["KDRP", "kdrp"])
def test_an_echoed_camera_info_is_read(tmp_path: Path, keys: str) -> None:
    K, D, R, P = keys
    text = "header:\n  seq: 1\n  frame_id: 'left'\nheight: 720\nwidth: 1280\ndistortion_model: \"plumb_bob\"\n"
    text += f"{D}: [-0.3, 0.1, 0.001, 0.002, 0.0]\n{K}: [1000.0, 0.0, 640.0, 0.0, 990.0, 360.0, 0.0, 0.0, 1.0]\n"
    text += f"{R}: [1.0]\n{P}: [1.0]\nbinning_x: 0\nroi:\n  x_offset: 0\n---\n"
    check(load_calibration(write(tmp_path, text))["camera"])


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ("fisheye_model: 1\n", "fisheye"),
        ("distortion_model: equidistant\n", "fisheye"),
        ("camera_model: fisheye\n", "fisheye"),
        ("model_type: KANNALA_BRANDT\n", "fisheye"),
        ("fisheye_model: 0\n", "pinhole"),
        ("type: pinhole\n", "pinhole"),
        ('model: "UI-3240"\ndistortion_model: radtan\n', "pinhole"),
    ],
)
def test_the_model_is_read_and_never_assumed(tmp_path: Path, stated: str, expected: str) -> None:
    found = read_calibration_file(write(tmp_path, HEAD + SIZE + FOUR + stated))
    camera = found.cameras["camera"]
    assert camera.model == expected and found.notes == ()
    assert camera.distortion.tolist() == [0.05, -0.01, 0.002, -0.001, 0.0][: len(camera.distortion)]


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("distortion_model: omnidirectional\n", "omnidirectional"),
        ("camera_model: ds\n", "ds"),
        ("distortion_model: fov\n", "fov"),
        ("model_type: MEI\n", "MEI"),
        ("distortion_model: inverse_brown_conrady\n", "inverse_brown_conrady"),
        ("distortion_model: [1, 2]\n", "distortion_model"),
        ("fisheye_model: 1\ndistortion_model: plumb_bob\n", "two lens models"),
    ],
)
def test_other_models_are_refused_by_name(tmp_path: Path, stated: str, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        load_calibration(write(tmp_path, HEAD + SIZE + FOUR + stated))
    with pytest.raises(CalibrationError, match="number of distortion coefficients"):
        load_calibration(write(tmp_path, ROS.format(model="plumb_bob", count=8, data=[0.1] * 8)))


def test_four_coefficients_of_no_stated_model_are_told_or_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path, HEAD + SIZE + FOUR)
    found = read_calibration_file(path)
    assert found.cameras["camera"].model == "pinhole" and "--calibration-model fisheye" in found.notes[0]
    found = read_calibration_file(path, model="fisheye")
    assert found.cameras["camera"].model == "fisheye" and found.notes == ()
    stated = write(tmp_path, HEAD + SIZE + FOUR + "distortion_model: plumb_bob\n")
    with pytest.raises(CalibrationError, match="another lens model"):
        read_calibration_file(stated, model="fisheye")


def stereo(T: str, extra: str = "") -> str:
    K = "[[1000, 0, 640], [0, 1000, 360], [0, 0, 1]]"
    text = f"{SIZE}M1: {K}\nM2: {K}\nD1: [0, 0, 0, 0, 0]\nD2: [0, 0, 0, 0, 0]\n"
    return text + f"R: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\nT: {T}\n" + extra


def apart_m(found: CalibrationFile) -> float:
    left, right = found.cameras.values()
    return float(np.linalg.norm(left.position_world_m - right.position_world_m))


@pytest.mark.parametrize(
    ("T", "remedy"),
    [
        ("[-500, 0, 0]", "times 0.001 it is 0.5 m"),
        ("[-60, 1, 0]", "times 0.001 it is 0.06 m"),
        ("[-16.6667, 0, 0]", "times 0.03 it is 0.5 m"),
        ("[0, -50, 0]", "times 0.01 it is 0.5 m"),
        ("[-0.0005, 0, 0]", "times 1000 it is 0.5 m"),
    ],
)
def test_a_baseline_that_cannot_be_metres_is_refused_with_the_factor(tmp_path: Path, T: str, remedy: str) -> None:
    with pytest.raises(CalibrationError, match="baseline of left and right") as caught:
        load_calibration(write(tmp_path, stereo(T)))
    assert remedy in str(caught.value)


def test_a_unit_that_is_stated_is_used_and_checked(tmp_path: Path) -> None:
    in_mm = write(tmp_path, stereo("[-500, 0, 0]"))
    assert apart_m(read_calibration_file(in_mm, unit="mm")) == pytest.approx(0.5)
    in_m = write(tmp_path, stereo("[-0.5, 0, 0]"), "m.yml")
    assert apart_m(read_calibration_file(in_m)) == pytest.approx(0.5)
    with pytest.raises(CalibrationError, match="--calibration-unit m"):
        read_calibration_file(in_m, unit="mm")
    far = write(tmp_path, HEAD + SIZE + FIVE + FAR, "w.yml")
    with pytest.raises(CalibrationError, match=r"position of camera.*2\.39 m \(millimetres"):
        load_calibration(far)


def test_a_rotation_of_few_digits_is_made_whole_and_one_that_is_none_is_refused(tmp_path: Path) -> None:
    rough = stereo("[-0.5, 0, 0]").replace("[[1, 0, 0], [0, 1, 0]", "[[0.9998, 0.0200, 0], [-0.0200, 0.9998, 0]")
    right = load_calibration(write(tmp_path, rough))["right"]
    np.testing.assert_allclose(right.T_world_camera[:3, :3] @ right.T_world_camera[:3, :3].T, np.eye(3), atol=1e-12)
    with pytest.raises(CalibrationError, match="rigid"):
        load_calibration(write(tmp_path, rough.replace("0.9998", "0.9")))


def test_kalibrs_equidistant_lens_is_a_fisheye_lens(tmp_path: Path) -> None:
    text = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [0.05, -0.01, 0.002, -0.001]
  distortion_model: equidistant
  intrinsics: [420.0, 415.0, 172.5, 129.5]
  resolution: [346, 260]
  rostopic: /davis/left/image_raw
"""
    camera = load_calibration(write(tmp_path, text))["cam0"]
    assert (camera.model, camera.distortion.tolist()) == ("fisheye", [0.05, -0.01, 0.002, -0.001])
    p = np.array([[0.4, -0.2, 0.5]])
    expected, _ = cv2.fisheye.projectPoints(p[None], np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    np.testing.assert_allclose(camera.project(p), expected.reshape(1, 2), atol=1e-9)


def test_dsecs_event_cameras_are_cam0_and_cam3(tmp_path: Path) -> None:
    def lens(f: float) -> dict[str, object]:
        return {
            "camera_model": "pinhole",
            "camera_matrix": [f, f, 320.0, 240.0],
            "distortion_coeffs": [-0.09, 0.1, 0.001, 0.002],
            "distortion_model": "radtan",
            "resolution": [640, 480],
        }

    steps = {"T_10": (-0.01, 0.0, 0.0), "T_21": (-0.5, 0.0, 0.0), "T_32": (-0.08, 0.002, 0.0)}
    T = {name: [[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1]] for name, (x, y, z) in steps.items()}
    tree = {
        "intrinsics": {f"cam{n}": lens(550.0 + n) for n in range(4)} | {"camRect0": {"resolution": [640, 480]}},
        "extrinsics": {**T, "R_rect0": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
        "disparity_to_depth": {"cams_03": [[1, 0, 0, 1]]},
    }
    found = read_calibration_file(write(tmp_path, json.dumps(tree), "cam_to_cam.yaml"))
    assert list(found.cameras) == ["left", "right"] and "cam1 and cam2 are left out" in found.notes[0]
    assert [camera.K[0, 0] for camera in found.cameras.values()] == [550, 553]
    np.testing.assert_allclose(found.cameras["right"].position_world_m, [0.59, -0.002, 0.0])
    assert found.cameras["left"].distortion.tolist() == [-0.09, 0.1, 0.001, 0.002, 0]
