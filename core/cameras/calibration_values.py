"""Checked access to the values of a parsed calibration file: every complaint names the file and the key."""

from __future__ import annotations

import re
from dataclasses import dataclass
from reprlib import Repr
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.camera import Camera
from core.cameras.distortion import LensModel
from core.errors import CalibrationError, EventsError
from core.events import SensorSize

Array = NDArray[np.float64]

LONGEST_LIST: Final = 64
"""No matrix of a calibration has more rows or columns. A few lines of YAML can name a list of lists of ... with
billions of numbers by anchors, which must not be counted, copied or printed."""


WIDTHS: Final = ("image_width", "width", "img_width")
HEIGHTS: Final = ("image_height", "height", "img_height")
SIZES: Final = ("resolution", "image_size", "img_size", "size", "camera_resolution", "sensor_size")
"""Names of a picture's size."""


def short_repr(value: object) -> str:
    """A value from a file as a person wants to see it in a message."""
    shortener = Repr()
    shortener.maxlevel = 2
    return shortener.repr(value)


@dataclass(frozen=True, slots=True)
class Unreadable:
    """Stands for a value that the parser could not make; only who asks for it complains."""

    reason: str


@dataclass(frozen=True, slots=True)
class FileMatrix:
    """A matrix as OpenCV and ROS write it: its shape, and its numbers in one row. Checked when it is asked for."""

    rows: object
    columns: object
    data: object


@dataclass(frozen=True, slots=True)
class CalibrationNode:
    """A mapping somewhere in a file."""

    values: dict[str, object]
    where: str

    @staticmethod
    def of(value: object, where: str) -> CalibrationNode:
        """Raises CalibrationError unless `value` is a mapping with plain names as keys."""
        if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
            got = "nothing" if value is None else type(value).__name__
            raise CalibrationError("not a table of named values", expected="keys with values", got=got, where=where)
        return CalibrationNode(value, where)

    def get(self, key: str) -> object:
        """Raises CalibrationError if the key is absent, or its value could not be read."""
        if key not in self.values:
            raise CalibrationError(f"no {key!r}", expected=f"{key} among the keys", where=self.where)
        value = self.values[key]
        if isinstance(value, Unreadable):
            raise CalibrationError(f"{key} cannot be read", got=value.reason, where=self.where)
        return value

    def find(self, *keys: str) -> str | None:
        """The first of the keys that is there, None if none is. `cameraMatrix` is also `Camera_Matrix`."""
        for key in keys:
            if key in self.values:
                return key
        plain = {plain_key(key): key for key in reversed(self.values) if len(key) > 2}
        return next((plain[plain_key(key)] for key in keys if len(key) > 2 and plain_key(key) in plain), None)

    def first(self, *keys: str) -> str:
        """The first of the keys that is there; raises CalibrationError if none is."""
        found = self.find(*keys)
        if found is None:
            raise CalibrationError("incomplete", expected=f"one of the keys {', '.join(keys)}", where=self.where)
        return found

    def without(self, key: str) -> CalibrationNode:
        """The mapping without a key."""
        return CalibrationNode({name: value for name, value in self.values.items() if name != key}, self.where)

    def child(self, key: str) -> CalibrationNode:
        """The mapping under a key; raises CalibrationError if there is none."""
        return CalibrationNode.of(self.get(key), f"{self.where}: {key}")


def plain_key(key: str) -> str:
    """The small letters and digits of a key or a name: `Distortion-Model` is `distortionmodel`."""
    return re.sub(r"[^a-z0-9]", "", key.lower())


def read_matrix(node: CalibrationNode, key: str, shape: tuple[int, ...]) -> Array:
    """A matrix of finite numbers of exactly this shape; nested or flat lists.

    Raises:
        CalibrationError: if it is absent or anything else.
    """
    values = read_numbers(node, key)
    if values.size != int(np.prod(shape)) or (values.ndim > 1 and values.squeeze().shape != shape):
        raise CalibrationError(f"{key} has the wrong shape", expected=shape, got=values.shape, where=node.where)
    return values.reshape(shape)


def read_numbers(node: CalibrationNode, key: str) -> Array:
    """An array of finite numbers of any shape.

    Raises:
        CalibrationError: if it is absent or anything else.
    """
    raw = _rows_of(node.get(key), key, node.where)
    if not _is_matrix_of_numbers(raw):
        raise CalibrationError(f"{key} is not a list of finite numbers", got=short_repr(raw), where=node.where)
    try:
        values = np.array(raw, np.float64)
    except (ValueError, OverflowError) as error:  # words, ragged, or an integer of hundreds of digits
        raise CalibrationError(f"{key} is not numbers", got=short_repr(raw), where=node.where) from error
    if not np.isfinite(values).all():
        raise CalibrationError(f"{key} is not a list of finite numbers", got=short_repr(raw), where=node.where)
    return values


def _rows_of(raw: object, key: str, where: str) -> object:
    """The nested lists of a matrix that states its shape; anything else as it is."""
    if isinstance(raw, dict) and "data" in raw:
        rows = raw.get("rows", raw.get("row"))
        columns = next((raw[name] for name in ("cols", "columns", "col") if name in raw), None)
        raw = FileMatrix(rows, columns, raw["data"])
    if not isinstance(raw, FileMatrix):
        return _words_apart(raw)
    rows, columns, data = raw.rows, raw.columns, _words_apart(raw.data)
    if not (isinstance(rows, int) and isinstance(columns, int) and isinstance(data, list)):
        raise CalibrationError(f"{key}: opencv-matrix without rows, cols and data", where=where)
    if rows < 0 or columns < 0 or rows * columns != len(data):
        got = f"opencv-matrix of {short_repr(rows)} x {short_repr(columns)} with {len(data)} numbers"
        raise CalibrationError(f"{key} is no matrix", got=got, where=where)
    return [data[row * columns : (row + 1) * columns] for row in range(rows)] if data else []


def _words_apart(data: object) -> object:
    """A list that was written without commas, `[0.1 0.2]`: ROS's camera_calibration did so."""
    if isinstance(data, list) and len(data) == 1 and isinstance(data[0], str):
        return data[0].split()
    return data


def _is_matrix_of_numbers(raw: object) -> bool:
    """A list of numbers, or of lists of numbers, not longer than `LONGEST_LIST`.

    Text may be a number: YAML 1.1 does not take 1e-05 for one, which yaml-cpp writes.
    """
    if not isinstance(raw, list) or len(raw) > LONGEST_LIST:
        return False
    rows = [row if isinstance(row, list) else [row] for row in raw]
    numbers = [number for row in rows if len(row) <= LONGEST_LIST for number in row]
    return len(numbers) == sum(map(len, rows)) and all(
        isinstance(number, int | float | str) and not isinstance(number, bool) for number in numbers
    )


def read_sensor(node: CalibrationNode, width_key: str, height_key: str) -> SensorSize:
    """Sensor size from two whole numbers.

    Raises:
        CalibrationError: if they are absent or impossible.
    """
    width, height = (_whole(node.get(key)) for key in (width_key, height_key))
    for key, value in ((width_key, width), (height_key, height)):
        if isinstance(value, bool) or not isinstance(value, int):
            raise CalibrationError(f"{key} is not a whole number", got=short_repr(value), where=node.where)
    try:
        return SensorSize(int(str(width)), int(str(height)))
    except EventsError as error:
        got = f"{short_repr(width)} x {short_repr(height)}"
        raise CalibrationError("impossible sensor size", got=got, where=node.where) from error


def _whole(value: object) -> object:
    """1280.0 and "1280" as whole numbers; anything else as it is."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e9:
        return int(value)
    return int(value) if isinstance(value, str) and re.fullmatch(r"[0-9]{1,9}", value) else value


def read_size(node: CalibrationNode) -> SensorSize:
    """The picture's size, by any of the names that tools give it.

    Raises:
        CalibrationError: if it is absent or impossible.
    """
    pair = node.find(*SIZES)
    if node.find(*WIDTHS) is None and pair is None:
        remedy = "add image_width and image_height, in pixels, of the pictures it was made from"
        raise CalibrationError("the file does not say for which picture size it is", where=node.where, remedy=remedy)
    if node.find(*WIDTHS) is not None or pair is None:
        return read_sensor(node, node.first(*WIDTHS), node.first(*HEIGHTS))
    if isinstance(node.get(pair), dict):
        return read_size(node.child(pair))
    width, height = read_matrix(node, pair, (2,))
    if width % 1 or height % 1:
        raise CalibrationError(f"{pair} is not whole", got=f"{width:g}, {height:g}", where=node.where)
    try:
        return SensorSize(int(width), int(height))
    except EventsError as error:
        raise CalibrationError(f"impossible {pair}", got=f"{width:g}x{height:g}", where=node.where) from error


def make_camera(
    sensor: SensorSize, K: Array, distortion: Array, T_world_camera: Array, where: str, model: LensModel = "pinhole"
) -> Camera:
    """A camera; what is impossible about it is reported with its place in the file.

    Args:
        sensor: size of the picture.
        K: (3, 3) camera matrix, px.
        distortion: (D,) coefficients as OpenCV orders them for the model.
        T_world_camera: (4, 4) pose, m.
        where: file and field, for the message.
        model: pinhole or fisheye.

    Raises:
        CalibrationError: if the values do not make a camera.
    """
    try:
        return Camera(sensor, K, distortion, T_world_camera, model)
    except CalibrationError as error:
        raise CalibrationError(str(error), where=where) from error
