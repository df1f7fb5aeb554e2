"""OpenCV's FileStorage YAML: one camera, or the pair that `stereoCalibrate` leaves behind."""

from __future__ import annotations

import numpy as np
import yaml

from core.cameras.calibration_values import (
    CalibrationNode,
    five_coefficients,
    make_camera,
    read_matrix,
    read_numbers,
    read_sensor,
)
from core.cameras.camera import Camera
from core.events import SensorSize
from core.geometry import check_transform, invert_transform, make_transform

SINGLE_K = ("camera_matrix", "cameraMatrix", "K")
SINGLE_DISTORTION = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D")
LEFT_K, RIGHT_K = ("M1", "K1", "cameraMatrix1"), ("M2", "K2", "cameraMatrix2")
LEFT_DISTORTION, RIGHT_DISTORTION = ("D1", "distCoeffs1"), ("D2", "distCoeffs2")
WIDTH, HEIGHT = ("image_width", "width"), ("image_height", "height")


class OpenCVLoader(yaml.SafeLoader):
    """PyYAML's safe loader that also knows `!!opencv-matrix`: a mapping of rows, cols, dt and data."""


def _construct_matrix(loader: yaml.SafeLoader, node: yaml.Node) -> list[object]:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.YAMLError("opencv-matrix without rows, cols and data")
    values = loader.construct_mapping(node, deep=True)
    rows, columns, data = values.get("rows"), values.get("cols"), values.get("data")
    if not (isinstance(rows, int) and isinstance(columns, int) and isinstance(data, list)):
        raise yaml.YAMLError("opencv-matrix without rows, cols and data")
    if rows < 1 or columns < 1 or rows * columns != len(data):
        raise yaml.YAMLError(f"opencv-matrix of {rows} x {columns} with {len(data)} numbers")
    return [data[row * columns : (row + 1) * columns] for row in range(rows)]


OpenCVLoader.add_constructor("tag:yaml.org,2002:opencv-matrix", _construct_matrix)


def cameras_from_opencv(tree: CalibrationNode, where: str) -> dict[str, Camera]:
    """`camera`, posed by `T_world_camera` if the file has one; or `left` and `right`, posed by R and T.

    R and T map left camera coordinates to right ones, as `stereoCalibrate` returns them; the world is the left camera.

    Raises:
        CalibrationError: if a key is missing or does not fit.
    """
    sensor = read_sensor(tree, tree.first(*WIDTH), tree.first(*HEIGHT))
    T_world_left = read_matrix(tree, "T_world_camera", (4, 4)) if "T_world_camera" in tree.values else np.eye(4)
    if not any(key in tree.values for key in LEFT_K):
        return {"camera": _camera(tree, sensor, SINGLE_K, SINGLE_DISTORTION, T_world_left)}
    R = read_matrix(tree, "R", (3, 3))
    T_right_left = check_transform(make_transform(R, read_matrix(tree, "T", (3,))), where=f"{where}: R, T")
    T_world_right = T_world_left @ invert_transform(T_right_left)
    return {
        "left": _camera(tree, sensor, LEFT_K, LEFT_DISTORTION, T_world_left),
        "right": _camera(tree, sensor, RIGHT_K, RIGHT_DISTORTION, T_world_right),
    }


def _camera(
    tree: CalibrationNode,
    sensor: SensorSize,
    K: tuple[str, ...],
    distortion: tuple[str, ...],
    T_world_camera: np.ndarray,
) -> Camera:
    coefficients = five_coefficients(read_numbers(tree, tree.first(*distortion)), tree.where)
    return make_camera(sensor, read_matrix(tree, tree.first(*K), (3, 3)), coefficients, T_world_camera, tree.where)
