"""OpenCV's FileStorage (YAML, XML or JSON) and ROS's camera_info: one camera, or the pair of `stereoCalibrate`.

Only what a camera needs is looked at: image points, errors, flags and whatever else is in the file may be anything.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Final
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import yaml
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from core.cameras.calibration_values import (
    SIZES,
    WIDTHS,
    Array,
    CalibrationNode,
    FileMatrix,
    Unreadable,
    make_camera,
    read_matrix,
    read_numbers,
    read_size,
    short_repr,
)
from core.cameras.camera import Camera
from core.cameras.distortion import LensModel
from core.cameras.lens_names import find_lens
from core.cameras.plausible import check_against_essential
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import check_transform, invert_transform, make_transform
from core.yaml_loader import UntaggedLoader

SINGLE_K: Final = ("camera_matrix", "cameraMatrix", "intrinsic_matrix", "intrinsics", "mtx", "K", "k")
SINGLE_DISTORTION: Final = (
    "distortion_coefficients",
    "distCoeffs",
    "dist_coeffs",
    "distortion_coeffs",
    "distortion_coefficents",
    "distortion",
    "dist",
    "D",
    "d",
)
LEFT_K: Final = ("M1", "K1", "cameraMatrix1", "left_camera_matrix", "camera_matrix_left", "cameraMatrixL", "mtx_l")
RIGHT_K: Final = ("M2", "K2", "cameraMatrix2", "right_camera_matrix", "camera_matrix_right", "cameraMatrixR", "mtx_r")
LEFT_DISTORTION: Final = (
    "D1",
    "distCoeffs1",
    "left_distortion_coefficients",
    "distortion_coefficients_left",
    "dist_coeffs_left",
    "distCoeffsL",
    "dist_l",
)
RIGHT_DISTORTION: Final = (
    "D2",
    "distCoeffs2",
    "right_distortion_coefficients",
    "distortion_coefficients_right",
    "dist_coeffs_right",
    "distCoeffsR",
    "dist_r",
)
_RECTIFIED: Final = (("R", (3, 3)), ("P", (3, 4)))
BROKEN_VALUE: Final = (yaml.YAMLError, ValueError, LookupError, AttributeError, TypeError)
ROUGH: Final = 1e-3
"""A rotation that was written with few digits is made whole; one that is farther off is none."""


NO_SKEW: Final = 1e-6
"""Largest skew, as a share of the focal length: a thousandth of a pixel at the edge of the picture."""


class OpenCVLoader(UntaggedLoader):
    """A safe loader that knows `!!opencv-matrix`, and leaves values that it cannot make to who asks for them."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> object:
        """The value of a node, or `Unreadable`."""
        try:
            return super().construct_object(node, deep)
        except BROKEN_VALUE as error:
            return Unreadable(f"{node.tag.rpartition(':')[2]}: {' '.join(str(error).split())[:120]}")

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        """The values of a mapping; a key that is written twice has none."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode) and key.value != "<<"]
        values = super().construct_mapping(node, deep)
        for key in values.keys() & {key for key in keys if keys.count(key) > 1} if len(set(keys)) < len(keys) else ():
            values[key] = Unreadable("it is written twice")
        return values


def _construct_matrix(loader: yaml.SafeLoader, node: yaml.Node) -> object:
    if not isinstance(node, yaml.MappingNode):
        return Unreadable("opencv-matrix without rows, cols and data")
    values = loader.construct_mapping(node, deep=True)
    sizes = values.get("sizes")
    if isinstance(sizes, list) and len(sizes) == 2:
        return FileMatrix(sizes[0], sizes[1], values.get("data"))
    return FileMatrix(values.get("rows"), values.get("cols"), values.get("data"))


OpenCVLoader.add_constructor("tag:yaml.org,2002:opencv-matrix", _construct_matrix)
OpenCVLoader.add_constructor("tag:yaml.org,2002:opencv-nd-matrix", _construct_matrix)


def tree_from_xml(text: str, where: str) -> CalibrationNode:
    """The values of OpenCV's `<opencv_storage>`.

    Raises:
        CalibrationError: if the text is no such XML.
    """
    try:
        root = fromstring(re.sub(r"\A\s*<\?xml[^>]*\?>", "", text), forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError) as error:
        raise CalibrationError("not XML that can be read", got=str(error)[:200], where=where) from error
    if root.tag != "opencv_storage":
        raise CalibrationError("not OpenCV's XML", expected="<opencv_storage>", got=f"<{root.tag}>", where=where)
    values: dict[str, object] = {}
    for child in root:
        twice = child.tag in values
        values[child.tag] = Unreadable("it is written twice") if twice else _value_of(child)
    return CalibrationNode(values, where)


def _value_of(element: Element) -> object:
    if element.get("type_id") in ("opencv-matrix", "opencv-nd-matrix"):
        parts = {child.tag: (child.text or "").split() for child in element}
        sizes = parts.get("sizes") or [*parts.get("rows", []), *parts.get("cols", [])]
        if len(sizes) != 2 or not all(size.isdecimal() and len(size) < 10 for size in sizes):
            return Unreadable("opencv-matrix without rows, cols and data")
        return FileMatrix(int(sizes[0]), int(sizes[1]), parts.get("data", []))
    if len(element):
        return {child.tag: _value_of(child) for child in element}
    text = (element.text or "").strip().strip('"')
    words = text.split()
    numbers = [_number(word) for word in words]
    if not words or not all(isinstance(number, (int, float)) for number in numbers):
        return text
    return numbers[0] if len(numbers) == 1 else numbers


def _number(word: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word


def cameras_from_opencv(
    tree: CalibrationNode, where: str, notes: list[str], asked: LensModel | None = None
) -> dict[str, Camera]:
    """`camera`, posed by `T_world_camera` if the file has one; or `left` and `right`, posed by R and T.

    R and T map left camera coordinates to right ones, as `stereoCalibrate` returns them; the world is the left camera.
    What was taken for granted is added to `notes`.

    Raises:
        CalibrationError: if a key is missing or does not fit.
    """
    _refuse_cropped(tree)
    found = tree.values.get(tree.find(*SINGLE_K, *LEFT_K, *RIGHT_K) or "")
    nowhere = found is None or (isinstance(found, dict) and "data" not in found)
    if nowhere and tree.find(*WIDTHS, *SIZES) is None:
        # Another tool's file may say both by other keys: which it has is the hint.
        keys = ", ".join(map(str, tree.values))
        what = "no camera matrix that is known, and the file does not say for which picture size it is"
        expected = f"one of the keys {', '.join(SINGLE_K)}; image_width, image_height"
        raise CalibrationError(what, expected=expected, got=f"the keys {keys[:120]}", where=where)
    sensor = read_size(tree)
    T_world_left = read_pose(tree, "T_world_camera") if "T_world_camera" in tree.values else np.eye(4)
    reader = _LensReader(tree, sensor, notes, asked)
    if tree.find(*LEFT_K) is None or tree.find(*RIGHT_K) is None:
        return {"camera": reader.camera(SINGLE_K, SINGLE_DISTORTION, T_world_left)}
    R, T = tree.first("R", "rotation_matrix"), tree.first("T", "translation_vector", "translation")
    T_right_left = rigid(read_matrix(tree, R, (3, 3)), read_matrix(tree, T, (3,)), f"{where}: R, T")
    essential = tree.find("E", "essential_matrix")
    if essential is not None and not isinstance(tree.values[essential], Unreadable):
        check_against_essential(read_matrix(tree, essential, (3, 3)), T_right_left, f"{where}: R, T, {essential}")
    return {
        "left": reader.camera(LEFT_K, LEFT_DISTORTION, T_world_left),
        "right": reader.camera(RIGHT_K, RIGHT_DISTORTION, T_world_left @ invert_transform(T_right_left)),
    }


def nested_cameras(tree: CalibrationNode) -> dict[str, CalibrationNode]:
    """The tables of two cameras or more that stand side by side, as messages of ROS in JSON do; none if there are not.

    A name is what tells it from the others: "cam0" for "/cam0/camera_info". R and T of a pair go from left to right,
    so that right never comes first.
    """
    if tree.find(*SINGLE_K, *LEFT_K, *RIGHT_K) is not None:
        return {}
    below = {key: value for key, value in tree.values.items() if isinstance(value, dict)}
    nodes = {key: CalibrationNode.of(value, f"{tree.where}: {key}") for key, value in below.items()}
    keys = sorted(nodes, key=lambda key: "right" in key.lower())
    nodes = {key: nodes[key] for key in keys if nodes[key].find(*SINGLE_K) and nodes[key].find(*WIDTHS, *SIZES)}
    names = [key.strip("/").removesuffix("/camera_info").replace("/", "_") for key in nodes]
    return dict(zip(names, nodes.values(), strict=True)) if len({*names}) == len(names) > 1 else {}


def cameras_from_nested(
    tree: CalibrationNode, nodes: dict[str, CalibrationNode], notes: list[str], asked: LensModel | None = None
) -> dict[str, Camera]:
    """Cameras in tables of their own; two of them are posed by R and T beside them, or by ROS's R and P of the pair.

    What was taken for granted is added to `notes`.

    Raises:
        CalibrationError: if a key is missing, or nothing says how the cameras stand to each other.
    """
    cameras = {name: cameras_from_opencv(node, node.where, notes, asked)["camera"] for name, node in nodes.items()}
    T_first_second = None
    if len(nodes) == 2 and {"R", "T"} <= tree.values.keys():
        T = rigid(read_matrix(tree, "R", (3, 3)), read_matrix(tree, "T", (3,)), f"{tree.where}: R, T")
        T_first_second = invert_transform(T)
    elif len(nodes) == 2 and all({"R", "P"} <= node.values.keys() for node in nodes.values()):
        Rs, Ps = ([read_matrix(one, key, shape) for one in nodes.values()] for key, shape in _RECTIFIED)
        T_first_second = pose_of_rectified(Rs, Ps)
        if T_first_second is not None:
            notes.append("The poses of the cameras are those of their rectification (R and P)")
    if T_first_second is None:
        expected = "R and T of a pair beside them, or R and P in them as ROS writes them for a rectified pair"
        what = f"the file does not say how {', '.join(nodes)} stand to each other"
        raise CalibrationError(what, expected=expected, where=tree.where)
    first, second = cameras
    return {first: cameras[first], second: replace(cameras[second], T_world_camera=T_first_second)}


def pose_of_rectified(Rs: Sequence[Array], Ps: Sequence[Array]) -> Array | None:
    """`T_first_second` (4, 4), m, of two cameras from R (3, 3) and P (3, 4) of each, as stereo calibration in ROS
    writes them: P of the right one has a shift. None if not exactly one has.
    """
    shifts_m = [-P[0, 3] / P[0, 0] if P[0, 0] > 0 else 0.0 for P in Ps]
    if sum(shift != 0 for shift in shifts_m) != 1:
        return None
    R_rectified_first, R_rectified_second = Rs
    # Seen from the left camera the right one stands at the shift; from the right one the left at the opposite place.
    return make_transform(
        R_rectified_first.T @ R_rectified_second,
        R_rectified_first.T @ np.array([shifts_m[1] - shifts_m[0], 0.0, 0.0]),
    )


def _refuse_cropped(tree: CalibrationNode) -> None:
    """Raises CalibrationError for a ROS camera_info of binned or cropped pictures: its K is for the whole sensor."""
    for key in ("binning_x", "binning_y"):
        if tree.values.get(key) not in (None, 0, 1):
            got = f"{key} {short_repr(tree.values[key])}"
            raise CalibrationError("the pictures are binned, and K is for the whole sensor", got=got, where=tree.where)
    roi = tree.values.get("roi")
    if isinstance(roi, dict) and any(roi.get(key) not in (None, 0) for key in ("x_offset", "y_offset")):
        got = f"x_offset {short_repr(roi.get('x_offset'))}, y_offset {short_repr(roi.get('y_offset'))}"
        raise CalibrationError(
            "the pictures are a part of the sensor, and K is for the whole", got=got, where=tree.where
        )


class _LensReader:
    """Reads the cameras of one file."""

    def __init__(self, tree: CalibrationNode, sensor: SensorSize, notes: list[str], asked: LensModel | None) -> None:
        self._tree, self._sensor, self._notes = tree, sensor, notes
        self._asked: LensModel | None = asked

    def camera(self, K: tuple[str, ...], distortion: tuple[str, ...], T_world_camera: Array) -> Camera:
        """One of the cameras."""
        tree = self._tree
        values = read_camera_matrix(tree, tree.first(*K))
        lens = find_lens(tree, read_numbers(tree, tree.first(*distortion)), asked=self._asked)
        if lens.assumed and lens.assumed not in self._notes:
            self._notes.append(lens.assumed)
        return make_camera(self._sensor, values, lens.distortion, T_world_camera, tree.where, lens.model)


def read_camera_matrix(node: CalibrationNode, key: str) -> Array:
    """K (3, 3) from a matrix, or from fx, fy, cx, cy in a list.

    Raises:
        CalibrationError: if it is neither.
    """
    values = read_numbers(node, key)
    if values.shape != (4,):
        return _upright(read_matrix(node, key, (3, 3)), f"{node.where}: {key}")
    fx, fy, cx, cy = values.ravel()
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _upright(K: Array, where: str) -> Array:
    """K without a skew of rounding; one that is transposed, as MATLAB has it, is refused as such."""
    if not K[:2, 2].any() and K[2, :2].any():
        remedy = "write fx, 0, cx in the first row, fy and cy in the second, 0, 0, 1 in the third"
        raise CalibrationError("the camera matrix is transposed, as MATLAB writes it", where=where, remedy=remedy)
    if 0 < abs(K[0, 1]) < NO_SKEW * abs(K[0, 0]):
        K = K.copy()
        K[0, 1] = 0.0
    return K


def read_pose(node: CalibrationNode, key: str) -> Array:
    """A rigid transform (4, 4) under a key.

    Raises:
        CalibrationError: if it is none.
    """
    T, where = read_matrix(node, key, (4, 4)), f"{node.where}: {key}"
    if not np.array_equal(T[3], (0, 0, 0, 1)):
        return check_transform(T, where=where)
    return rigid(T[:3, :3], T[:3, 3], where)


def rigid(R: Array, t: Array, where: str) -> Array:
    """(4, 4) from a rotation, which may have been written with few digits, and a translation.

    Raises:
        CalibrationError: if it is no rotation.
    """
    if np.abs(R).max() < 2 and 1e-9 < np.abs(R @ R.T - np.eye(3)).max() < ROUGH:
        u, _, v = np.linalg.svd(R)
        R = np.asarray(u @ v, np.float64)
    return check_transform(make_transform(R, t), where=where)
