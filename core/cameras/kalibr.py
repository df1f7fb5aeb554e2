"""Kalibr's camchain YAML: cam0, cam1, ..., each posed against the one before it."""

from __future__ import annotations

import re

import numpy as np

from core.cameras.calibration_values import (
    CalibrationNode,
    five_coefficients,
    make_camera,
    read_matrix,
    read_numbers,
    short_repr,
)
from core.cameras.camera import Camera
from core.errors import CalibrationError, EventsError
from core.events import SensorSize
from core.geometry import check_transform, invert_transform


def looks_like_kalibr(tree: CalibrationNode) -> bool:
    """Whether the top level is cam0, cam1, ... with Kalibr's keys."""
    first = tree.values.get("cam0")
    return isinstance(first, dict) and ("camera_model" in first or "intrinsics" in first)


def cameras_from_kalibr(tree: CalibrationNode, where: str) -> dict[str, Camera]:
    """The cameras cam0, cam1, ...; the world is cam0's frame.

    Raises:
        CalibrationError: if a key is missing or a model is not pinhole with radtan.
    """
    names = sorted((name for name in tree.values if re.fullmatch(r"cam\d+", name)), key=lambda name: int(name[3:]))
    cameras: dict[str, Camera] = {}
    T_world_camera = np.eye(4)
    for index, name in enumerate(names):
        node = CalibrationNode.of(tree.values[name], f"{where}: {name}")
        if index:
            T_camera_before = read_matrix(node, "T_cn_cnm1", (4, 4))
            T_world_camera = T_world_camera @ invert_transform(check_transform(T_camera_before, where=node.where))
        cameras[name] = _camera(node, T_world_camera)
    return cameras


def _camera(node: CalibrationNode, T_world_camera: np.ndarray) -> Camera:
    model = (node.get("camera_model"), node.values.get("distortion_model", "none"))
    if model not in (("pinhole", "radtan"), ("pinhole", "none")):
        got = " with ".join(part[:40] if isinstance(part, str) else short_repr(part) for part in model)
        raise CalibrationError("unsupported camera model", expected="pinhole with radtan", got=got, where=node.where)
    fx, fy, cx, cy = read_matrix(node, "intrinsics", (4,))
    width, height = read_matrix(node, "resolution", (2,))
    if width % 1 or height % 1:
        raise CalibrationError("resolution is not whole", got=f"{width}, {height}", where=node.where)
    try:
        sensor = SensorSize(int(width), int(height))
    except EventsError as error:
        raise CalibrationError("impossible resolution", got=f"{width:g}x{height:g}", where=node.where) from error
    coefficients = read_numbers(node, "distortion_coeffs") if model[1] == "radtan" else np.zeros(0)
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return make_camera(sensor, K, five_coefficients(coefficients, node.where), T_world_camera, node.where)
