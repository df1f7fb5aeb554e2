"""Calibration files, told apart by their content: ours (TOML), OpenCV's FileStorage, ROS, Kalibr, DSEC and Sony's rigs.

All but ours and Sony's know no world: there, the first camera's frame is the world until the rig is aligned to the
table.
All count pixels from the centre of the top left one, as we do. Nothing in a file is ever executed.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import tomli_w
import yaml

from core.cameras.calibration_values import CalibrationNode, Unreadable, make_camera, read_numbers, read_sensor
from core.cameras.camera import Camera
from core.cameras.distortion import LensModel
from core.cameras.kalibr import (
    camera_from_euroc,
    cameras_from_dsec,
    cameras_from_kalibr,
    cameras_from_world_poses,
    looks_like_dsec,
    looks_like_kalibr,
    looks_like_world_poses,
)
from core.cameras.lens_names import find_lens
from core.cameras.opencv_yaml import (
    OpenCVLoader,
    cameras_from_opencv,
    read_camera_matrix,
    read_pose,
    tree_from_xml,
)
from core.cameras.units import Unit, check_lengths, in_metres
from core.errors import CalibrationError
from core.files import replace_file
from core.text.toml_text import parse_toml

FORMAT: Final = "rallyscope-calibration"
VERSION: Final = 1
LARGEST_FILE_BYTES: Final = 1 << 20
"""A calibration is a few kilobytes; this keeps a video given by mistake out of the parser."""
YAML_ERRORS: Final = (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError, RecursionError)
"""What PyYAML raises over text that is no YAML."""
MARKS: Final = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
"""Byte-order marks, as editors of Windows write them."""


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
    if FORMAT in text[:4096] and not text.startswith("%YAML"):
        cameras = _cameras_from_toml(text, path, model)
    else:
        where = str(path)
        tree = tree_from_xml(text, where) if text.lstrip().startswith("<") else _parse_yaml(text, path)
        cameras = _cameras_from_tree(tree, where, notes, model)
    if not cameras:
        raise CalibrationError("no camera in it", expected=f"a {FORMAT} file, OpenCV YAML or a camchain", where=path)
    cameras = in_metres(cameras, unit)
    check_lengths(cameras, path)
    return CalibrationFile(cameras, tuple(notes))


def _cameras_from_tree(
    tree: CalibrationNode, where: str, notes: list[str], model: LensModel | None
) -> dict[str, Camera]:
    if looks_like_dsec(tree):
        return cameras_from_dsec(tree, notes, model)
    if looks_like_kalibr(tree):
        return cameras_from_kalibr(tree, model)
    if looks_like_world_poses(tree):
        return cameras_from_world_poses(tree, notes, model)
    if isinstance(tree.values.get("intrinsics"), list) and "resolution" in tree.values:
        return camera_from_euroc(tree, model)
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
    encoding = next((name for mark, name in MARKS if content.startswith(mark)), "utf-8")
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        if encoding != "utf-8" or re.search(rb"[\x00-\x08\x0e-\x1f]", content):
            raise CalibrationError("not a text file", expected="TOML or YAML", where=path) from error
        return content.decode("latin-1")  # a comment of an old editor; numbers and names are the same in all


def _cameras_from_toml(text: str, path: Path, model: LensModel | None) -> dict[str, Camera]:
    try:
        tree = parse_toml(text)
    except ValueError as error:
        raise CalibrationError("not a TOML file", got=str(error)[:200], where=path) from error
    where = str(path)
    if (tree.get("format"), tree.get("version")) != (FORMAT, VERSION):
        got = f"{tree.get('format')!r} version {tree.get('version')!r}"
        raise CalibrationError("unknown format", expected=f"{FORMAT!r} version {VERSION}", got=got, where=where)
    root = CalibrationNode.of(tree.get("cameras"), f"{where}: cameras")
    return {
        name: _camera_from_toml(CalibrationNode.of(root.values[name], f"{root.where}.{name}"), model)
        for name in root.values
    }


def _camera_from_toml(node: CalibrationNode, model: LensModel | None) -> Camera:
    lens = find_lens(node, read_numbers(node, "distortion"), asked=model, default="pinhole")
    return make_camera(
        read_sensor(node, "width_px", "height_px"),
        read_camera_matrix(node, "K"),
        lens.distortion,
        read_pose(node, "T_world_camera"),
        node.where,
        lens.model,
    )


def _parse_yaml(text: str, path: Path) -> CalibrationNode:
    # OpenCV writes "%YAML:1.0", which is no valid directive; comments may stand before it.
    text = re.sub(r"\A((?:[ \t\r]*(?:#[^\n]*)?\n)*)%YAML[: ][0-9.]+[^\n]*\n(---[^\n]*\n)?", "", text)
    try:
        # A SafeLoader: makes plain values, runs nothing. What `rostopic echo` prints ends with "---".
        tree: object = next((tree for tree in yaml.load_all(text, Loader=OpenCVLoader) if tree is not None), None)
    except YAML_ERRORS as error:
        raise CalibrationError("neither TOML nor YAML", got=str(error)[:200], where=path) from error
    if isinstance(tree, Unreadable):
        raise CalibrationError("neither TOML nor YAML", got=tree.reason, where=path)
    return CalibrationNode.of(tree, str(path))
