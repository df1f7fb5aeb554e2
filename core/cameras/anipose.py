"""The `calibration.toml` of aniposelib, which Caliscope and Pose2Sim write too: a table for each camera.

`size`, `matrix` and `distortions`; `rotation` (a rotation vector, or a matrix) and `translation` take coordinates of
the world to the camera. The world is the tool's own, and so is the unit: that of its board.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from core.cameras.calibration_values import CalibrationNode, make_camera, read_matrix, read_numbers, read_size
from core.cameras.camera import Camera
from core.cameras.distortion import LensModel
from core.cameras.lens_names import find_lens
from core.cameras.opencv_yaml import read_camera_matrix, rigid
from core.errors import CalibrationError
from core.geometry import invert_transform

_KEYS: Final = {"matrix", "distortions"}


def anipose_tables(tree: CalibrationNode) -> CalibrationNode | None:
    """The tables of a file of this kind: at its top, or below `cameras`; None for any other file."""
    for values, where in ((tree.values, tree.where), (tree.values.get("cameras"), f"{tree.where}: cameras")):
        if isinstance(values, dict) and any(isinstance(one, dict) and one.keys() >= _KEYS for one in values.values()):
            return CalibrationNode.of({str(key): value for key, value in values.items()}, where)
    return None


def cameras_from_anipose(tables: CalibrationNode, notes: list[str], asked: LensModel | None) -> dict[str, Camera]:
    """The cameras by their `name`, or by that of their table; the world is the file's.

    Raises:
        CalibrationError: if a key is missing, or two cameras have one name.
    """
    cameras: dict[str, Camera] = {}
    for key, value in tables.values.items():
        if not isinstance(value, dict) or not value.keys() & _KEYS:  # [metadata]
            continue
        node = tables.child(key)
        if node.values.get("ignore") is True:  # Caliscope: left out of the calibration, without a pose
            notes.append(f"{node.where} is to be ignored, as it says")
            continue
        turn = read_numbers(node, "rotation")
        R = (
            cv2.Rodrigues(read_matrix(node, "rotation", (3,)))[0]
            if turn.size == 3
            else read_matrix(node, "rotation", (3, 3))
        )
        T_camera_world = rigid(np.asarray(R, np.float64), read_matrix(node, "translation", (3,)), node.where)
        lens = find_lens(node, read_numbers(node, "distortions"), asked=asked, default="pinhole")
        name = str(node.values.get("name", key))
        if name in cameras:
            raise CalibrationError("two cameras of one name", got=repr(name), where=node.where)
        K, pose = read_camera_matrix(node, "matrix"), invert_transform(T_camera_world)
        cameras[name] = make_camera(read_size(node), K, lens.distortion, pose, node.where, lens.model)
    return cameras
