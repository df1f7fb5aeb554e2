"""Calibration files: ours (TOML), OpenCV's FileStorage YAML and Kalibr's camchain YAML, told apart by their content.

OpenCV and Kalibr know no world: there, the first camera's frame is the world until the rig is aligned to the table.
All three count pixels from the centre of the top left one, as we do. Nothing in a file is ever executed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import tomli_w
import yaml

from core.cameras.calibration_values import CalibrationNode, make_camera, read_matrix, read_sensor
from core.cameras.camera import Camera
from core.cameras.kalibr import cameras_from_kalibr, looks_like_kalibr
from core.cameras.opencv_yaml import OpenCVLoader, cameras_from_opencv
from core.errors import CalibrationError
from core.files import replace_file
from core.text.toml_text import parse_toml

FORMAT: Final = "rallyscope-calibration"
VERSION: Final = 1
LARGEST_FILE_BYTES: Final = 1 << 20
"""A calibration is a few kilobytes; this keeps a video given by mistake out of the parser."""
YAML_ERRORS: Final = (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError, RecursionError)
"""What PyYAML raises over text that is no YAML, and over values that are not what their tag says (`!!bool 7`)."""


def load_calibration(path: Path) -> dict[str, Camera]:
    """The cameras of a calibration file by name, in the file's order.

    Raises:
        CalibrationError: one line that names the file and the key, whatever is wrong with it.
    """
    text = _read_text(path)
    if FORMAT in text[:4096] and not text.startswith("%YAML"):
        cameras = _cameras_from_toml(text, path)
    else:
        tree = _parse_yaml(text, path)
        where = str(path)
        cameras = cameras_from_kalibr(tree, where) if looks_like_kalibr(tree) else cameras_from_opencv(tree, where)
    if not cameras:
        raise CalibrationError("no camera in it", expected=f"a {FORMAT} file, OpenCV YAML or a camchain", where=path)
    return cameras


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
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise CalibrationError("cannot read the calibration", got=error.strerror, where=path) from error
    except UnicodeDecodeError as error:
        raise CalibrationError("not a text file", expected="TOML or YAML", where=path) from error


def _cameras_from_toml(text: str, path: Path) -> dict[str, Camera]:
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
        name: _camera_from_toml(CalibrationNode.of(root.values[name], f"{root.where}.{name}")) for name in root.values
    }


def _camera_from_toml(node: CalibrationNode) -> Camera:
    return make_camera(
        read_sensor(node, "width_px", "height_px"),
        read_matrix(node, "K", (3, 3)),
        read_matrix(node, "distortion", (5,)),
        read_matrix(node, "T_world_camera", (4, 4)),
        node.where,
    )


def _parse_yaml(text: str, path: Path) -> CalibrationNode:
    # OpenCV writes "%YAML:1.0", which is no valid directive.
    text = re.sub(r"\A%YAML[: ][0-9.]+[^\n]*\n(---[^\n]*\n)?", "", text)
    try:
        tree: object = yaml.load(text, Loader=OpenCVLoader)  # a SafeLoader: makes plain values, runs nothing
    except YAML_ERRORS as error:
        raise CalibrationError("neither TOML nor YAML", got=str(error)[:200], where=path) from error
    return CalibrationNode.of(tree, str(path))
