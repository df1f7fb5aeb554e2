"""Declarations of message fields: bounds, checks and wire format in one place.

Only msgpack's basic types travel. Arrays are packed little-endian bytes whose length must fit whole rows.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np

from core.config import config_from_mapping, config_to_mapping
from core.errors import ConfigError, LinkError

MAX_EVENTS: Final = 2_000_000
"""In one batch: two hundred times what a busy block of 10 ms holds."""
MAX_ROWS: Final = 10_000
COMMAND_BYTES: Final = 64 << 10
MESSAGE_BYTES: Final = 32 << 20
LONGEST_US: Final = 24 * 3600 * 1_000_000
WALL_NS: Final = 1 << 62


Wire = object
"""None, bool, int, float, str, bytes, or a list or str-keyed dict of them."""
REQUIRED: Final = dataclasses.MISSING
LONGEST_ERROR: Final = 300


@dataclass(frozen=True, slots=True)
class Spec:
    """Reading and writing of a field; `read` raises LinkError with the place for invalid values."""

    read: Callable[[Wire, str], Any]
    write: Callable[[Any], Wire]


def whole(low: int, high: int, default: object = REQUIRED) -> Any:
    """An int in [low, high]."""

    def read(value: Wire, where: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise LinkError("not such a whole number", expected=f"{low} to {high}", got=_short(value), where=where)
        return value

    return _field(Spec(read, int), default)


def numbered(kind: type[IntEnum]) -> Any:
    """A member of an enumeration, as its number."""
    numbers = whole(min(kind), max(kind)).metadata["spec"]
    return _field(Spec(lambda value, where: kind(numbers.read(value, where)), int), REQUIRED)


def bounded_number(low: float, high: float, *, nan: bool = False, default: object = REQUIRED) -> Any:
    """A float in [low, high]; or NaN, where that means unknown.

    Args:
        low: smallest value.
        high: largest value.
        nan: whether NaN, for unknown, is possible.
        default: of a field that may be missing.
    """
    return _field(Spec(lambda value, where: _number(value, low, high, nan, where), float), default)


def vector(length: int | tuple[int, ...], bound: float, *, nan: bool = False, default: object = REQUIRED) -> Any:
    """A tuple of `length` floats (or of one of several lengths), each within `bound` of zero.

    Args:
        length: number of components, or several that are possible.
        bound: largest absolute value.
        nan: whether NaN, for unknown, is possible.
        default: of a field that may be missing.
    """
    lengths = (length,) if isinstance(length, int) else length

    def read(value: Wire, where: str) -> tuple[float, ...]:
        if not isinstance(value, (list, tuple)) or len(value) not in lengths:
            expected = f"{' or '.join(map(str, lengths))} numbers"
            raise LinkError("not a vector", expected=expected, got=_short(value), where=where)
        return tuple(_number(item, -bound, bound, nan, where) for item in value)

    return _field(Spec(read, lambda value: [float(item) for item in value]), default)


def text(longest: int, default: object = REQUIRED) -> Any:
    """A str of at most `longest` characters."""

    def read(value: Wire, where: str) -> str:
        if not isinstance(value, str) or len(value) > longest:
            raise LinkError("not such a text", expected=f"up to {longest} characters", got=_short(value), where=where)
        return value

    return _field(Spec(read, str), default)


def texts(most_bytes: int) -> Any:
    """A tuple of str of at most `most_bytes` bytes together, in UTF-8; empty by default."""

    def read(value: Wire, where: str) -> tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or not all(isinstance(item, str) for item in value):
            raise LinkError("not a list of texts", got=_short(value), where=where)
        if text_bytes(value) > most_bytes:
            raise LinkError("texts too long", expected=f"up to {most_bytes} bytes", got=text_bytes(value), where=where)
        return tuple(value)

    return _field(Spec(read, list), ())


def text_bytes(items: Iterable[str]) -> int:
    """Length of all texts together in UTF-8."""
    return sum(len(item.encode()) for item in items)


def choice(*names: str) -> Any:
    """One of some strings."""

    def read(value: Wire, where: str) -> str:
        if not isinstance(value, str) or value not in names:
            raise LinkError("no such choice", expected=", ".join(names), got=_short(value), where=where)
        return value

    return _field(Spec(read, str), REQUIRED)


def flag(default: object = REQUIRED) -> Any:
    """True or False."""

    def read(value: Wire, where: str) -> bool:
        if not isinstance(value, bool):
            raise LinkError("not true or false", got=_short(value), where=where)
        return value

    return _field(Spec(read, bool), default)


def optional(inner: Any) -> Any:
    """Another field's value or None, the default."""
    spec: Spec = inner.metadata["spec"]
    either = Spec(
        lambda value, where: None if value is None else spec.read(value, where),
        lambda value: None if value is None else spec.write(value),
    )
    return _field(either, None)


def column(dtype: str, *row_shape: int, most: int) -> Any:
    """A read-only array (N, *row_shape) of at most `most` rows; `dtype` names a little-endian type."""
    wire_type = np.dtype(dtype)
    row_bytes = wire_type.itemsize * math.prod(row_shape)

    def read(value: Wire, where: str) -> np.ndarray:
        if not isinstance(value, bytes) or len(value) % row_bytes or len(value) > most * row_bytes:
            expected = f"up to {most} rows of {row_bytes} bytes"
            raise LinkError("not such a column", expected=expected, got=_short(value), where=where)
        return np.frombuffer(value, wire_type).reshape(-1, *row_shape)

    def write(value: np.ndarray) -> bytes:
        return np.ascontiguousarray(value, wire_type).tobytes()

    return _field(Spec(read, write), REQUIRED)


def settings(kind: type) -> Any:
    """A config (`core.config`) as nested maps, whole and within its own bounds."""

    def read(value: Wire, where: str) -> object:
        try:
            return config_from_mapping(kind, _whole_settings(kind, value, where), where=where)
        except ConfigError as error:
            raise LinkError(str(error)[:LONGEST_ERROR]) from error

    return _field(Spec(read, config_to_mapping), REQUIRED)


def listing(kind: type, most: int) -> Any:
    """A tuple of at most `most` values of a dataclass whose fields are declared here too."""

    def read(value: Wire, where: str) -> tuple[object, ...]:
        if not isinstance(value, list) or len(value) > most:
            raise LinkError("not such a list", expected=f"up to {most} entries", got=_short(value), where=where)
        return tuple(read_fields(kind, item, where) for item in value)

    return _field(Spec(read, lambda value: [write_fields(item) for item in value]), ())


def part(kind: type) -> Any:
    """A dataclass whose fields are declared here too, as a map."""
    return _field(Spec(lambda value, where: read_fields(kind, value, where), write_fields), REQUIRED)


def read_fields(kind: type, values: Wire, where: str) -> Any:
    """A `kind` from a mapping of its fields; unknown keys are ignored, so that a later version may add some.

    Raises:
        LinkError: if a field is missing, of another type, or out of bounds.
    """
    if not isinstance(values, dict):
        raise LinkError("not a map of fields", got=_short(values), where=where)
    found: dict[str, object] = {}
    for item in dataclasses.fields(kind):
        if item.name in values:
            found[item.name] = item.metadata["spec"].read(values[item.name], f"{where}.{item.name}")
        elif item.default is dataclasses.MISSING:
            raise LinkError("a field is missing", where=f"{where}.{item.name}")
    return kind(**found)


def write_fields(value: Any) -> dict[str, Wire]:
    """The mapping that `read_fields` reads."""
    return {item.name: item.metadata["spec"].write(getattr(value, item.name)) for item in dataclasses.fields(value)}


def _whole_settings(kind: type, values: Wire, where: str) -> dict[str, Wire]:
    """The settings of a config among `values`: others are ignored, as unknown fields are; none may be missing."""
    if not isinstance(values, dict):
        raise LinkError("not a map of settings", got=_short(values), where=where)
    found: dict[str, Wire] = {}
    for item in dataclasses.fields(kind):
        if item.name not in values:
            raise LinkError("a setting is missing", where=f"{where}.{item.name}")
        default, value = getattr(kind(), item.name), values[item.name]
        nested = dataclasses.is_dataclass(default)
        found[item.name] = _whole_settings(type(default), value, f"{where}.{item.name}") if nested else value
    return found


def _number(value: Wire, low: float, high: float, nan: bool, where: str) -> float:
    expected = f"{low:g} to {high:g}"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise LinkError("not a number", expected=expected, got=_short(value), where=where)
    if nan and math.isnan(value):
        return math.nan
    if not low <= value <= high:
        raise LinkError("out of bounds", expected=expected, got=_short(value), where=where)
    return float(value)


def _field(spec: Spec, default: object) -> Any:
    return dataclasses.field(default=default, metadata={"spec": spec})  # type: ignore[reportArgumentType]


def _short(value: Wire) -> str:
    """Shortened value for an error message."""
    if isinstance(value, (bytes, str, list, dict)):
        return f"{type(value).__name__} of length {len(value)}"
    return repr(value)[:40]
