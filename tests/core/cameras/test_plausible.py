"""Calibrations that cannot be right are refused with the likely cause; what is odd is noted, what is right is not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from core.cameras import Camera
from core.cameras.calibration_file import CalibrationFile, read_calibration_file
from core.cameras.plausible import odd_lenses
from core.errors import CalibrationError
from core.events import SensorSize
from core.foreign_tables import Unit
from core.geometry import invert_transform, look_at

pytestmark = pytest.mark.numeric
SIZE = "image_width: 1280\nimage_height: 720\n"
LENS = "distortion_coefficients: [-0.3, 0.1, 0.001, 0.001, 0]\n"
K = "[[1000, 0, 640], [0, 1000, 360], [0, 0, 1]]"
IDENTITY = "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"


def read(tmp_path: Path, text: str, unit: Unit = "m") -> CalibrationFile:
    path = tmp_path / "cameras.yml"
    path.write_text(text)
    return read_calibration_file(path, unit=unit)


def one(fx: float = 1000, fy: float = 1000, cx: float = 640, cy: float = 360, size: str = SIZE) -> str:
    return f"{size}camera_matrix: [[{fx}, 0, {cx}], [0, {fy}, {cy}], [0, 0, 1]]\n{LENS}"


def pair(T: str = "[-0.5, 0, 0]", R: str = IDENTITY, more: str = "") -> str:
    lenses = f"M1: {K}\nM2: {K}\nD1: [0, 0, 0, 0, 0]\nD2: [0, 0, 0, 0, 0]\n"
    return f"{SIZE}{lenses}R: {R}\nT: {T}\n{more}"


def camchain(second: str, first: str = "", model: str = "distortion_model: radtan\n") -> str:
    camera = "camera_model: pinhole\nintrinsics: [1000, 1000, 640, 360]\nresolution: [1280, 720]\n"
    camera += "distortion_coeffs: [-0.3, 0.1, 0.001, 0.001]\n" + model
    parts = {"cam0": camera + first, "cam1": camera + second}
    return "".join(f"{name}:\n" + "".join(f"  {line}\n" for line in text.splitlines()) for name, text in parts.items())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (one(8, 8), "divide millimetres by the size of a pixel"),
        (one(0.8, 1.4, 0.5, 0.5), "multiply shares of the picture"),
        (one(1e6, 1e6), "focal length cannot be"),
        (one(1000, 400), "fx and fy differ too much"),
        (one(cx=1600), "K may be for another picture size"),
        (one(cx=640, cy=360, size="image_width: 500\nimage_height: 1280\n"), "width and height seem to be exchanged"),
        (one().replace("-0.3, 0.1", "-0.9, 0.1"), "the distortion cannot be right"),
        (SIZE + "camera_matrix: [[1000, 0, 0], [0, 1000, 0], [640, 360, 1]]\n" + LENS, "transposed, as MATLAB"),
        (one() + f"camera_matrix: {K}\n", "camera_matrix cannot be read; got it is written twice"),
        (one(size=""), "does not say for which picture size"),
        (pair(R="[[1, 0, 0], [0, 1, 0], [0, 0, -1]]"), "not a rigid transform"),
        (pair(R="[[1.01, 0, 0], [0, 1.01, 0], [0, 0, 1.01]]"), "not a rigid transform"),
    ],
)
def test_a_camera_that_cannot_be_is_refused_with_the_likely_cause(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        read(tmp_path, text)


def test_right_files_are_read_without_a_remark_about_their_values(tmp_path: Path) -> None:
    assert read(tmp_path, one()).notes == ()
    (world,) = read(tmp_path, pair()).notes
    assert world == "The calibration does not say where the table is: the world is the frame of left"
    skewed = read(tmp_path, one().replace("[[1000, 0,", "[[1000, 1e-9,"))
    assert skewed.cameras["camera"].K[0, 1] == 0 and skewed.notes == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (one(cx=320, cy=180), "far from the middle of 1280x720"),
        (one(cx=361, cy=639), "cx 361 and cy 639 seem to be exchanged"),
        (one(1000, 850), "fx 1000 and fy 850 differ"),
        (one() + "---\n" + one(2000, 2000), "several documents"),
        (pair("[0.5, 0, 0]"), "right stands 0.5 m to the left of left"),
        (pair("[-7, 0, 0]"), "7 m apart: if that is wrong, see --calibration-unit"),
        (pair("[-0.008, 0, 0]"), "0.008 m apart"),
        (one().replace("-0.3, 0.1", "-0.62, 0.1"), "no ray for"),
    ],
)
def test_what_is_odd_but_possible_is_read_and_said(tmp_path: Path, text: str, said: str) -> None:
    assert said in "; ".join(read(tmp_path, text).notes)


def test_a_board_of_large_squares_tells_the_unit_of_the_poses(tmp_path: Path) -> None:
    in_mm = pair("[-8, 0, 0]", more="square_size: 30.\n")
    with pytest.raises(CalibrationError, match=r"squares of 30 m.*--calibration-unit mm"):
        read(tmp_path, in_mm)
    cameras = read(tmp_path, in_mm, unit="mm").cameras
    assert cameras["right"].position_world_m[0] == pytest.approx(0.008)
    with pytest.raises(CalibrationError, match="counted in squares of the board"):
        read(tmp_path, pair("[-8, 0, 0]", more="square_size: 1\n"))
    assert read(tmp_path, one() + "square_size: 30\n").cameras, "one lens has no lengths"
    cm = read(tmp_path, pair("[-50, 0, 0]", more="square_size: 3\n"), unit="cm")
    assert cm.cameras["right"].position_world_m[0] == pytest.approx(0.5)


def test_an_essential_matrix_tells_that_r_and_t_are_the_other_way_round(tmp_path: Path) -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    R, T = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), np.array([-0.5, 0.02, 0.1])
    x, y, z = T
    E = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ R
    right = pair(str(T.tolist()), str(R.tolist()), f"E: {(3 * E).tolist()}\n")
    assert read(tmp_path, right).cameras["right"].position_world_m == pytest.approx(-R.T @ T)
    with pytest.raises(CalibrationError, match="other way round than E"):
        read(tmp_path, pair(str((-R.T @ T).tolist()), str(R.T.tolist()), f"E: {E.tolist()}\n"))


def test_cameras_that_do_not_see_the_table_are_said(tmp_path: Path) -> None:
    T = look_at((-1.0, 1.5, 1.2), (0, 0, 0))
    text = one() + f"T_world_camera: {T.ravel().tolist()}\n"
    assert read(tmp_path, text).notes == ()
    behind = read(tmp_path, one() + f"T_world_camera: {look_at((1.0, 1.5, 1.2), (3.0, 4.0, 2.0)).ravel().tolist()}\n")
    assert "looks away from the world's origin" in behind.notes[0]
    inverse = read(tmp_path, one() + f"T_world_camera: {invert_transform(T).ravel().tolist()}\n")
    assert "with its pose the other way round (T_camera_world) it would" in inverse.notes[0]


def test_binned_and_cropped_pictures_of_ros_are_refused(tmp_path: Path) -> None:
    text = "height: 720\nwidth: 1280\ndistortion_model: plumb_bob\nD: [0, 0, 0, 0, 0]\n"
    text += "K: [1000, 0, 640, 0, 1000, 360, 0, 0, 1]\n"
    assert read(tmp_path, text + "binning_x: 1\nroi: {x_offset: 0, y_offset: 0, height: 0, width: 0}\n").notes == ()
    with pytest.raises(CalibrationError, match="binned"):
        read(tmp_path, text + "binning_x: 2\nbinning_y: 2\n")
    with pytest.raises(CalibrationError, match="part of the sensor"):
        read(tmp_path, text + "roi: {x_offset: 320, y_offset: 0, height: 480, width: 640}\n")


def test_kalibrs_poses_come_from_the_chain_or_from_the_imu(tmp_path: Path) -> None:
    T = "[[1,0,0,-0.5],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"
    chain = read(tmp_path, camchain(f"T_cn_cnm1: {T}\ntimeshift_cam_imu: 0.01\n"))
    assert chain.cameras["cam1"].position_world_m.tolist() == [0.5, 0, 0]
    assert "timeshift_cam_imu" in chain.notes[0]
    eye = "T_cam_imu: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"
    imu = read(tmp_path, camchain(f"T_cam_imu: {T}\n", eye))
    assert imu.cameras["cam1"].position_world_m.tolist() == [0.5, 0, 0]
    with pytest.raises(CalibrationError, match="no cam1 before cam2"):
        read(tmp_path, camchain(f"T_cn_cnm1: {T}\n").replace("cam1", "cam2"))
    with pytest.raises(CalibrationError, match="T_cn_cnm1"):
        read(tmp_path, camchain(f"T_cnm1_cn: {T}\n"))


def test_kalibrs_coefficients_without_a_model_are_not_dropped(tmp_path: Path) -> None:
    T = "T_cn_cnm1: [[1,0,0,-0.5],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"
    found = read(tmp_path, camchain(T, model=""))
    assert found.cameras["cam0"].distortion.tolist() == [-0.3, 0.1, 0.001, 0.001, 0]
    assert "names no lens model" in found.notes[0]
    with pytest.raises(CalibrationError, match="wrong number of distortion coefficients; expected 0"):
        read(tmp_path, camchain(T, model="distortion_model: none\n"))


def test_our_format_may_be_json_and_json_may_have_tabs(tmp_path: Path) -> None:
    pose = look_at((-1.0, 1.5, 1.2), (0, 0, 0)).tolist()
    camera = {"width_px": 1280, "height_px": 720, "K": json.loads(K), "distortion": [0] * 5, "T_world_camera": pose}
    tree = {"format": "rallyscope-calibration", "version": 1, "cameras": {"a": camera}}
    found = read(tmp_path, json.dumps(tree, indent="\t"))
    assert list(found.cameras) == ["a"] and found.cameras["a"].T_world_camera == pytest.approx(np.array(pose))
    with pytest.raises(CalibrationError, match="version 2"):
        read(tmp_path, json.dumps(tree | {"version": 2}))


@pytest.mark.parametrize("size", ["image_width: 1280.\nimage_height: 720.0\n", 'width: "1280"\nheight: "720"\n'])
def test_sizes_written_as_text_or_with_a_point_are_whole_numbers(tmp_path: Path, size: str) -> None:
    assert str(read(tmp_path, one(size=size)).cameras["camera"].sensor) == "1280x720"


def test_a_rig_posed_at_the_table_has_no_remark_that_its_place_is_unknown(tmp_path: Path) -> None:
    T_WO = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]])
    text = ""
    for name, place in (("a", (-1.0, 1.5, 1.2)), ("b", (-1.0, -1.5, 1.2))):
        T_CW = invert_transform(look_at(place, (0, 0, 0))) @ invert_transform(T_WO)
        lens = "camera_matrix: [[1000, 0, 640], [0, 1000, 360], [0, 0, 1]], distortion_coeffs: [0, 0, 0, 0]"
        text += f"{name}: {{resolution: [1280, 720], {lens}, T_CW: {T_CW.tolist()}}}\n"
    at_table = read(tmp_path, text + f"T_WO: {T_WO.tolist()}\n")
    np.testing.assert_allclose(at_table.cameras["a"].position_world_m, (-1.0, 1.5, 1.2), atol=1e-9)
    assert [note.endswith("the world is the frame O of T_WO") for note in at_table.notes] == [True]
    assert any("does not say where the table is" in note for note in read(tmp_path, text).notes)


def test_a_fisheye_lens_need_not_have_pinhole_rays_beyond_90_degrees_but_up_to_there() -> None:
    K = np.array([[250.0, 0, 640], [0, 250.0, 360], [0, 0, 1]])  # 640 px are 2.56 focal lengths
    for coefficients in [(0.1, 0.0, 0.0, 0.0), (0.0, 0.01, 0.0, 0.0), (0.02, 0.0, 0.001, 0.0001)]:
        wide = Camera(SensorSize(1280, 720), K, np.array(coefficients), np.eye(4), "fisheye")
        assert not np.isfinite(wide.undistort(np.array([[0.0, 360.0]]))).any(), "beyond 90 degrees"
        assert odd_lenses({"wide": wide}) == []
    folds = Camera(SensorSize(1280, 720), K, np.array([-0.3, 0.0, 0.0, 0.0]), np.eye(4), "fisheye")
    (said,) = odd_lenses({"folds": folds})  # its largest radius is 0.7 focal lengths: a disc of a tenth of the picture
    assert "gives no ray for 89." in said or "gives no ray for 90." in said
