"""Checked access to the values of a parsed calibration file: every complaint names the file and the key."""

from __future__ import annotations

from dataclasses import dataclass
from reprlib import Repr
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.camera import Camera
from core.errors import CalibrationError, EventsError
from core.events import SensorSize

Array = NDArray[np.float64]

LONGEST_LIST: Final = 64
"""No matrix of a calibration has more rows or columns. A few lines of YAML can name a list of lists of ... with
billions of numbers by anchors, which must not be counted, copied or printed."""


def short_repr(value: object) -> str:
    """A value from a file as a person wants to see it in a message."""
    shortener = Repr()
    shortener.maxlevel = 2
    return shortener.repr(value)


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
        """Raises CalibrationError if the key is absent."""
        if key not in self.values:
            raise CalibrationError(f"no {key!r}", expected=f"{key} among the keys", where=self.where)
        return self.values[key]

    def first(self, *keys: str) -> str:
        """The first of the keys that is there; raises CalibrationError if none is."""
        for key in keys:
            if key in self.values:
                return key
        raise CalibrationError("incomplete", expected=f"one of the keys {', '.join(keys)}", where=self.where)


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
    raw = node.get(key)
    if not _is_matrix_of_numbers(raw):
        raise CalibrationError(f"{key} is not a list of finite numbers", got=short_repr(raw), where=node.where)
    try:
        values = np.array(raw, np.float64)
    except (ValueError, OverflowError) as error:  # words, ragged, or an integer of hundreds of digits
        raise CalibrationError(f"{key} is not numbers", got=short_repr(raw), where=node.where) from error
    if not np.isfinite(values).all():
        raise CalibrationError(f"{key} is not a list of finite numbers", got=short_repr(raw), where=node.where)
    return values


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
    width, height = node.get(width_key), node.get(height_key)
    for key, value in ((width_key, width), (height_key, height)):
        if isinstance(value, bool) or not isinstance(value, int):
            raise CalibrationError(f"{key} is not a whole number", got=short_repr(value), where=node.where)
    try:
        return SensorSize(int(str(width)), int(str(height)))
    except EventsError as error:
        got = f"{short_repr(width)} x {short_repr(height)}"
        raise CalibrationError("impossible sensor size", got=got, where=node.where) from error


def five_coefficients(coefficients: Array, where: str) -> Array:
    """OpenCV's k1 k2 p1 p2 k3 from any of OpenCV's lengths.

    Raises:
        CalibrationError: for a model that has more than these five.
    """
    flat = coefficients.ravel()
    if flat.size not in (0, 4, 5, 8, 12, 14):
        raise CalibrationError("wrong number of distortion coefficients", expected="4 or 5", got=flat.size, where=where)
    if flat[5:].any():
        remedy = "calibrate again without the rational, thin prism or tilted model"
        raise CalibrationError("unsupported distortion", expected="k1 k2 p1 p2 k3", where=where, remedy=remedy)
    five = np.zeros(5)
    five[: min(5, flat.size)] = flat[:5]
    return five


def make_camera(sensor: SensorSize, K: Array, distortion: Array, T_world_camera: Array, where: str) -> Camera:
    """A camera; what is impossible about it is reported with its place in the file.

    Raises:
        CalibrationError: if the values do not make a camera.
    """
    try:
        return Camera(sensor, K, distortion, T_world_camera)
    except CalibrationError as error:
        raise CalibrationError(str(error), where=where) from error
