"""Calibration files, told apart by their content: ours (TOML, JSON), OpenCV's, ROS, Kalibr, DSEC,
anipose (TOML), camodocal and Sony's rigs.

All but ours and Sony's know no world: there, the first camera's frame is the world until the rig is aligned to the
table.
All count pixels from the centre of the top left one, as we do. Nothing in a file is ever executed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import tomli_w
import yaml

from core.cameras.anipose import anipose_tables, cameras_from_anipose
from core.cameras.calibration_values import (
    CalibrationNode,
    Unreadable,
    make_camera,
    read_numbers,
    read_sensor,
    short_repr,
)
from core.cameras.camera import Camera
from core.cameras.distortion import LensModel
from core.cameras.kalibr import (
    camera_from_euroc,
    camera_from_kalibr_table,
    cameras_from_dsec,
    cameras_from_kalibr,
    cameras_from_world_poses,
    kalibr_tables,
    looks_like_dsec,
    looks_like_kalibr,
    looks_like_world_poses,
)
from core.cameras.lens_names import find_lens
from core.cameras.opencv_yaml import (
    OpenCVLoader,
    cameras_from_nested,
    cameras_from_opencv,
    nested_cameras,
    read_camera_matrix,
    read_pose,
    tree_from_xml,
)
from core.cameras.plausible import check_lenses, check_rows_downwards, odd_lenses, odd_poses
from core.cameras.slam_files import camera_from_camodocal, looks_like_camodocal, tree_from_ros_ini
from core.cameras.units import check_board_unit, check_lengths, in_metres, stated_unit
from core.errors import CalibrationError
from core.files import replace_file
from core.foreign_tables import Unit
from core.text import compression_of, decode_text, parse_toml

FORMAT: Final = "rallyscope-calibration"
VERSION: Final = 1
LARGEST_FILE_BYTES: Final = 1 << 20
"""A calibration is a few kilobytes; this keeps a video given by mistake out of the parser."""
_TOML_LINE: Final = re.compile(r"\[\[?[A-Za-z_][\w.\"' -]*\]\]?\s*(#.*)?$|[A-Za-z_][\w.\"'-]*\s*=")
"""A line that TOML begins with: `[table]` or `key =`; none of YAML."""
_OTHERS: Final = (
    (re.compile(r"# Camera list with one line of data per camera"), "COLMAP's list of cameras"),
    (re.compile(r'\{\s*"value0"\s*:\s*\{\s*"T_imu_cam"'), "a calibration of Basalt"),
    (re.compile(r"(%.*\n\s*)*fc\s*=\s*\["), "results of the Camera Calibration Toolbox for MATLAB"),
)
"""How files begin that are recognised and not read."""
_BY_HAND: Final = "write image_width, image_height, camera_matrix and distortion_coefficients as JSON or YAML"
YAML_ERRORS: Final = (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError, RecursionError)
"""What PyYAML raises over text that is no YAML."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFile:
    """The cameras of a calibration file."""

    cameras: dict[str, Camera]
    """By name, in the file's order."""
    notes: tuple[str, ...]
    """What the file does not say and was taken for granted, a line each."""


def load_calibration(path: Path) -> dict[str, Camera]:
    """The cameras of a calibration file by name, in the file's order; lengths in metres.

    Raises:
        CalibrationError: one line that names the file and the key, whatever is wrong with it.
    """
    return read_calibration_file(path).cameras


def read_calibration_file(path: Path, *, unit: Unit = "m", model: LensModel | None = None) -> CalibrationFile:
    """The cameras of a calibration file, and what was assumed about them.

    `unit` is that of the file's lengths; `model` is the lens model of files that do not name one.

    Raises:
        CalibrationError: one line that names the file and the key, whatever is wrong with it.
    """
    text = _read_text(path)
    notes: list[str] = []
    tree = _parse(text, path, notes)
    check_rows_downwards(tree)
    unit = stated_unit(tree, unit)
    cameras = _cameras_from_tree(tree, str(path), notes, model, unit)
    if not cameras:
        raise CalibrationError("no camera in it", expected=f"a {FORMAT} file, OpenCV YAML or a camchain", where=path)
    check_lenses(cameras, path)
    cameras = in_metres(cameras, unit)
    check_lengths(cameras, path)
    own_world = tree.values.get("format") != FORMAT and not {"T_world_camera", "T_WO"} & tree.values.keys()
    notes += [*odd_lenses(cameras), *odd_poses(cameras, own_world=own_world)]
    return CalibrationFile(cameras, tuple(notes))


def _parse(text: str, path: Path, notes: list[str]) -> CalibrationNode:
    """The named values of a text, whatever its form."""
    start = text.lstrip()
    if start.startswith("<") and not start.startswith("<<"):
        return tree_from_xml(text, str(path))
    if (ini := tree_from_ros_ini(text, str(path))) is not None:
        return ini
    if start.startswith("Calibration results\n"):
        remedy = "give the camchain YAML that Kalibr wrote beside it"
        raise CalibrationError("Kalibr's report, which is for people", where=path, remedy=remedy)
    for beginning, what in _OTHERS:
        if beginning.match(start):
            raise CalibrationError(f"{what}, which is not read", where=path, remedy=_BY_HAND)
    if (FORMAT in text[:4096] and not start.startswith(("%YAML", "{"))) or _TOML_LINE.match(_first_line(text)):
        return _parse_toml(text, path)
    return _parse_yaml(text, path, notes)


def _first_line(text: str) -> str:
    """The first line that is neither empty nor a comment."""
    lines = (line.strip() for line in text.splitlines())
    return next((line for line in lines if line and not line.startswith("#")), "")


def _cameras_from_tree(
    tree: CalibrationNode, where: str, notes: list[str], model: LensModel | None, unit: Unit
) -> dict[str, Camera]:
    if tree.values.get("format") == FORMAT:
        return _cameras_from_ours(tree, model)
    check_board_unit(tree, unit)
    if (tables := anipose_tables(tree)) is not None:
        return cameras_from_anipose(tables, notes, model)
    if looks_like_dsec(tree):
        return cameras_from_dsec(tree, notes, model)
    if looks_like_kalibr(tree):
        return cameras_from_kalibr(tree, notes, model)
    if looks_like_camodocal(tree):
        return camera_from_camodocal(tree)
    if kalibr_tables(tree):
        return camera_from_kalibr_table(tree, notes, model)
    if looks_like_world_poses(tree):
        return cameras_from_world_poses(tree, notes, model)
    if isinstance(tree.values.get("intrinsics"), list) and "resolution" in tree.values:
        return camera_from_euroc(tree, notes, model)
    if nodes := nested_cameras(tree):
        return cameras_from_nested(tree, nodes, notes, model)
    return cameras_from_opencv(tree, where, notes, model)


def save_calibration(path: Path, cameras: Mapping[str, Camera]) -> None:
    """Write our own format, replacing the file in one step.

    Raises:
        CalibrationError: if the file cannot be written.
    """
    tables = {
        name: {
            "width_px": camera.sensor.width_px,
            "height_px": camera.sensor.height_px,
            "K": camera.K.tolist(),
            "distortion": camera.distortion.tolist(),
            **({} if camera.model == "pinhole" else {"model": camera.model}),
            "T_world_camera": camera.T_world_camera.tolist(),
        }
        for name, camera in cameras.items()
    }
    text = tomli_w.dumps({"format": FORMAT, "version": VERSION, "cameras": tables})
    try:
        replace_file(path, text.encode(), durable=True)
    except OSError as error:
        raise CalibrationError("cannot write the calibration", got=error.strerror, where=path) from error


def _read_text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE_BYTES:
            got = f"{size} bytes"
            raise CalibrationError("too large for a calibration", expected="at most 1 MiB", got=got, where=path)
        content = path.read_bytes()
    except OSError as error:
        raise CalibrationError("cannot read the calibration", got=error.strerror, where=path) from error
    if content.startswith(b"\x93NUMPY") or (content.startswith(b"PK") and b".npy" in content[:1024]):
        raise CalibrationError("arrays of NumPy, whose names no tool agrees on", where=path, remedy=_BY_HAND)
    if (packed := compression_of(content)) is not None:
        raise CalibrationError(f"the file is compressed ({packed})", where=path, remedy="unpack it first")
    try:
        return decode_text(content)
    except UnicodeDecodeError as error:
        raise CalibrationError("not a text file", expected="TOML, YAML, XML or JSON", where=path) from error


def _parse_toml(text: str, path: Path) -> CalibrationNode:
    try:
        return CalibrationNode(parse_toml(text), str(path))
    except ValueError as error:
        raise CalibrationError("not a TOML file", got=str(error)[:200], where=path) from error


def _cameras_from_ours(tree: CalibrationNode, model: LensModel | None) -> dict[str, Camera]:
    if tree.values.get("version") != VERSION:
        got = f"{FORMAT!r} version {short_repr(tree.values.get('version'))}"
        raise CalibrationError("unknown format", expected=f"{FORMAT!r} version {VERSION}", got=got, where=tree.where)
    root = CalibrationNode.of(tree.values.get("cameras"), f"{tree.where}: cameras")
    return {
        name: _camera_of_ours(CalibrationNode.of(root.values[name], f"{root.where}.{name}"), model)
        for name in root.values
    }


def _camera_of_ours(node: CalibrationNode, model: LensModel | None) -> Camera:
    lens = find_lens(node, read_numbers(node, "distortion"), asked=model, default="pinhole")
    return make_camera(
        read_sensor(node, "width_px", "height_px"),
        read_camera_matrix(node, "K"),
        lens.distortion,
        read_pose(node, "T_world_camera"),
        node.where,
        lens.model,
    )


def _parse_yaml(text: str, path: Path, notes: list[str]) -> CalibrationNode:
    # OpenCV writes "%YAML:1.0", which is no valid directive; comments may stand before it.
    text = re.sub(r"\A((?:[ \t\r]*(?:#[^\n]*)?\n)*)%YAML[: ][0-9.]+[^\n]*\n(---[^\n]*\n)?", "", text)
    if text.lstrip().startswith("{"):  # JSON is YAML but for tabs, which its texts cannot hold
        text = text.replace("\t", " ")
    try:
        # A SafeLoader: makes plain values, runs nothing. What `rostopic echo` prints ends with "---".
        trees = (tree for tree in yaml.load_all(text, Loader=OpenCVLoader) if tree is not None)
        tree: object = next(trees, None)
        another: object = next(trees, None)
    except YAML_ERRORS as error:
        raise CalibrationError("neither TOML nor YAML", got=" ".join(str(error).split())[:200], where=path) from error
    if isinstance(tree, Unreadable):
        raise CalibrationError("neither TOML nor YAML", got=tree.reason, where=path)
    if another is not None:
        notes.append(f"{path} holds several documents, one after the other: the first is read")
    return CalibrationNode.of(tree, str(path))
