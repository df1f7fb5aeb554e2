"""Kalibr's camchain YAML (cam0, cam1, ..., each posed against the one before it), and files with its keys.

DSEC's `cam_to_cam.yaml`; and rigs of cameras by name, each with its pose T_CW (camera from world), as Sony's.
"""

from __future__ import annotations

import re

import numpy as np

from core.cameras.calibration_values import (
    Array,
    CalibrationNode,
    make_camera,
    read_numbers,
    read_size,
    short_repr,
)
from core.cameras.camera import Camera
from core.cameras.distortion import LensModel
from core.cameras.lens_names import SUPPORTED, find_lens
from core.cameras.opencv_yaml import read_camera_matrix, read_pose
from core.errors import CalibrationError
from core.geometry import invert_transform

DSEC_EVENTS = {"left": 0, "right": 3}
"""Our name -> number of DSEC's event cameras; cam1 and cam2 take ordinary pictures."""

KEYS = {"intrinsics", "resolution"}
"""Keys that mark a camera in Kalibr's files."""


def looks_like_kalibr(tree: CalibrationNode) -> bool:
    """Whether the top level is cam0, cam1, ... with Kalibr's keys."""
    first = tree.values.get("cam0")
    return isinstance(first, dict) and ("camera_model" in first or "intrinsics" in first)


def kalibr_tables(tree: CalibrationNode) -> list[str]:
    """The tables of a file at whose top are cameras with Kalibr's keys, whatever they are called."""
    return [name for name, value in tree.values.items() if isinstance(value, dict) and value.keys() >= KEYS]


def camera_from_kalibr_table(tree: CalibrationNode, notes: list[str], asked: LensModel | None) -> dict[str, Camera]:
    """The one camera of such a file, by the name of its table; the world is its frame.

    Raises:
        CalibrationError: if there are several: which one a pose is against is told by cam0, cam1, ... only.
    """
    names = kalibr_tables(tree)
    if len(names) > 1:
        got, remedy = ", ".join(names)[:120], "name them in the order of their poses"
        raise CalibrationError(
            "the cameras have other names", expected="cam0, cam1", got=got, where=tree.where, remedy=remedy
        )
    return {names[0]: _camera(tree.child(names[0]), np.eye(4), "intrinsics", notes, asked)}


def looks_like_dsec(tree: CalibrationNode) -> bool:
    """Whether the file has DSEC's intrinsics and extrinsics of four cameras."""
    lenses, poses = tree.values.get("intrinsics"), tree.values.get("extrinsics")
    return isinstance(lenses, dict) and isinstance(poses, dict) and "cam0" in lenses and "T_10" in poses


def looks_like_world_poses(tree: CalibrationNode) -> bool:
    """Whether the top level has cameras by name, each with its matrix and T_CW."""
    return any(isinstance(value, dict) and {"T_CW", "camera_matrix"} <= value.keys() for value in tree.values.values())


def cameras_from_world_poses(
    tree: CalibrationNode, notes: list[str], asked: LensModel | None = None
) -> dict[str, Camera]:
    """The cameras of a rig by name; the world is the frame O of T_WO, where the file has one (Sony's: the table).

    Raises:
        CalibrationError: if a key is missing, or a model is not ours.
    """
    T_world_object = read_pose(tree, "T_WO") if "T_WO" in tree.values else np.eye(4)
    cameras: dict[str, Camera] = {}
    for name, value in tree.values.items():
        if isinstance(value, dict):
            node = tree.child(name)
            T_camera_world = read_pose(node, "T_CW") @ T_world_object
            lens = find_lens(node, read_numbers(node, "distortion_coeffs"), asked=asked, default="pinhole")
            K, pose = read_camera_matrix(node, "camera_matrix"), invert_transform(T_camera_world)
            cameras[name] = make_camera(read_size(node), K, lens.distortion, pose, node.where, lens.model)
    frame = "the frame O of T_WO" if "T_WO" in tree.values else "the frame W of T_CW"
    notes.append(f"{tree.where}: the world is {frame}")
    return cameras


def cameras_from_kalibr(tree: CalibrationNode, notes: list[str], asked: LensModel | None = None) -> dict[str, Camera]:
    """The cameras cam0, cam1, ...; the world is cam0's frame.

    Each is posed by T_cn_cnm1, which takes coordinates of the camera before it to its own, or by T_cam_imu of both.

    Raises:
        CalibrationError: if a key is missing, or a model is not ours.
    """
    names = sorted((name for name in tree.values if re.fullmatch(r"cam\d{1,4}", name)), key=lambda name: int(name[3:]))
    cameras: dict[str, Camera] = {}
    T_world_camera = np.eye(4)
    for index, name in enumerate(names):
        node = tree.child(name)
        if name != f"cam{index}":
            raise CalibrationError(f"no cam{index} before {name}, which is posed against it", where=tree.where)
        if index:
            T_world_camera = T_world_camera @ invert_transform(_to_camera_before(tree, node, index))
        shift = node.values.get("timeshift_cam_imu")
        if shift not in (None, 0):
            notes.append(f"{name}: timeshift_cam_imu of {short_repr(shift)} s is not used; see --offset-us")
        cameras[name] = _camera(node, T_world_camera, "intrinsics", notes, asked)
    return cameras


def _to_camera_before(tree: CalibrationNode, node: CalibrationNode, index: int) -> Array:
    """`T_camera_before` of a camera."""
    before = tree.child(f"cam{index - 1}")
    if "T_cn_cnm1" not in node.values and "T_cam_imu" in node.values and "T_cam_imu" in before.values:
        return read_pose(node, "T_cam_imu") @ invert_transform(read_pose(before, "T_cam_imu"))
    return read_pose(node, "T_cn_cnm1")


def cameras_from_dsec(tree: CalibrationNode, notes: list[str], asked: LensModel | None = None) -> dict[str, Camera]:
    """DSEC's two event cameras, `left` (cam0) and `right` (cam3); the world is the left one's frame.

    Raises:
        CalibrationError: if a key is missing, or a model is not ours.
    """
    lenses, poses = tree.child("intrinsics"), tree.child("extrinsics")
    T_right_left = np.eye(4)
    for step in ("T_10", "T_21", "T_32"):  # T_ba takes coordinates of camera a to camera b
        T_right_left = read_pose(poses, step) @ T_right_left
    T_world = {"left": np.eye(4), "right": invert_transform(T_right_left)}
    notes.append(f"{tree.where}: cam0 and cam3, the event cameras, are left and right; cam1 and cam2 are left out")
    return {
        name: _camera(lenses.child(f"cam{number}"), T_world[name], "camera_matrix", notes, asked)
        for name, number in DSEC_EVENTS.items()
    }


def _camera(
    node: CalibrationNode, T_world_camera: Array, intrinsics: str, notes: list[str], asked: LensModel | None
) -> Camera:
    model = node.values.get("camera_model", "pinhole")
    if not isinstance(model, str) or model.lower() not in ("pinhole", "none"):
        got = model[:40] if isinstance(model, str) else short_repr(model)
        raise CalibrationError("unsupported camera model", expected=SUPPORTED, got=got, where=node.where)
    if read_numbers(node, intrinsics).size not in (4, 9):
        what, got = f"{intrinsics} has the wrong shape", read_numbers(node, intrinsics).shape
        raise CalibrationError(what, expected="fx, fy, cx, cy", got=got, where=node.where)
    key = node.find("distortion_coeffs", "distortion_coefficients")
    if key is None and node.values.get("distortion_model") not in ("none", None):
        key = "distortion_coeffs"
    coefficients = np.zeros(0) if key is None else read_numbers(node, key)
    # Kalibr's "pinhole" is the projection only; without a distortion_model it does not say what the numbers are.
    lens = find_lens(
        node.without("camera_model"), coefficients, asked=asked, default=None if coefficients.any() else "none"
    )
    if lens.assumed:
        notes.append(lens.assumed)
    K = read_camera_matrix(node, intrinsics)
    return make_camera(read_size(node), K, lens.distortion, T_world_camera, node.where, lens.model)


def camera_from_euroc(tree: CalibrationNode, notes: list[str], asked: LensModel | None = None) -> dict[str, Camera]:
    """`camera` of a file that describes one camera with Kalibr's keys, as EuRoC's `sensor.yaml` does.

    Raises:
        CalibrationError: if a key is missing, or a model is not ours.
    """
    if "T_BS" in tree.values:
        notes.append(f"{tree.where}: T_BS, the pose on the sensor's body, is not used: the world is the camera's frame")
    return {"camera": _camera(tree, np.eye(4), "intrinsics", notes, asked)}
