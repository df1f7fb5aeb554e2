"""The size of the sensor as files state it: in attributes of HDF5 and in headers of text, in their many spellings."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from core.events import SensorSize

_LARGEST_PX: Final = 16384
_PAIR: Final = re.compile(
    r"(?:geometry|resolution|(?:sensor|image|frame)[_ ]?size|sensor(?=\W{0,4}\d+\s*[x×*])|dimensions?|\bsize)"
    r"(?:\s*[(\[]?\s*(h|w)\w*\s*[x,*]\s*[hw]\w*\s*[)\]]?)?\W{0,4}"
    r"(\d+)\s*(?:px|pixels?)?\s*[x×,;*\s]\s*(\d+)",
    re.IGNORECASE,
)
_BOTH: Final = re.compile(r"\b(width|height)\W{1,4}(?:width|height)\W{1,5}(\d+)\s*[x×,;*\s]\s*(\d+)", re.IGNORECASE)
"""Names first and numbers after: `height, width = 720, 1280`."""
_SIDES: Final = tuple(
    re.compile(rf"(?:\b|_)(?:{side})(?:_px)?\W{{0,4}}(\d+)", re.IGNORECASE)
    for side in ("width|w(?==)|sizeX", "height|h(?==)|sizeY")
)
_ALONE: Final = re.compile(r"^\W*(\d+)(?:\s*[x×*]\s*|[\s,;]+)(\d+)\W*$", re.MULTILINE)
"""A line of two numbers."""
_SIDE_NAMES: Final = (
    ("width", "height"),
    *((f"{what}width", f"{what}height") for what in ("sensor", "image", "img", "frame", "camera")),
    ("widthpx", "heightpx"),
    ("sensorwidthpx", "sensorheightpx"),
    ("sizex", "sizey"),
    ("xresolution", "yresolution"),
    ("resolutionx", "resolutiony"),
    ("numcols", "numrows"),
    ("cols", "rows"),
    ("w", "h"),
)
_PAIRS: Final = ("geometry", "resolution", "sensorsize", "sensorsizepx", "imagesize", "framesize", "cameraresolution")
"""Attributes that list the width first."""
_UPRIGHT: Final = ("sensorresolution", "size", "shape", "imsize", "imgsize", "hw", "dims", "imgshape", "frameshape")
"""Attributes that list the height first or the width: no convention holds."""


def size_of(width: object, height: object) -> SensorSize | None:
    """A size if both are whole numbers that a sensor can have."""
    try:
        w, h = int(str(width)), int(str(height))
    except ValueError:
        return None
    return SensorSize(w, h) if 0 < w <= _LARGEST_PX and 0 < h <= _LARGEST_PX else None


def size_in_text(lines: Iterable[str]) -> SensorSize | None:
    """The size that comment lines state, such as `%geometry:1280,720` or `# width 346, height 260`."""
    text = "\n".join(lines)
    pair = _BOTH.search(text) or _PAIR.search(text)
    if pair is not None:
        first, a, b = pair.groups()
        return size_of(b, a) if first and first.lower().startswith("h") else size_of(a, b)
    sides = [side.search(text) for side in _SIDES]
    if all(sides):
        return size_of(*(found.group(1) for found in sides if found))
    alone = _ALONE.search(text)
    return None if alone is None else size_of(*alone.groups())


def size_in_attributes(attributes: Mapping[str, object], largest: tuple[int, int] | None = None) -> SensorSize | None:
    """The size that attributes state, as numbers, text or bytes.

    `sensor_resolution` is (height, width) or (width, height); `largest`, the largest column and row, tells which.
    """
    words = {re.sub(r"[\W_]", "", str(name).lower()): _word(value) for name, value in attributes.items()}
    for width, height in _SIDE_NAMES:
        if (found := size_of(words.get(width), words.get(height))) is not None:
            return found
    for name in _PAIRS:
        numbers = re.findall(r"\d+", words.get(name, ""))
        if len(numbers) >= 2 and (found := size_of(*numbers[:2])) is not None:
            return found
    listed = (re.findall(r"\d+", words.get(name, "")) for name in _UPRIGHT)
    numbers = next((found for found in listed if len(found) == 2), None)
    if numbers is None:
        return None
    a, b = (int(number) for number in numbers[:2])
    if largest is not None and largest[0] >= b > largest[1] and largest[0] < a:
        return size_of(a, b)  # the width first: the columns do not fit otherwise
    if largest is not None and largest[1] >= min(a, b) and largest[0] < min(a, b):
        return size_of(min(a, b), max(a, b))  # a sensor that stands upright
    return size_of(max(a, b), min(a, b))


def _word(value: object) -> str:
    array = np.asarray(value)
    if array.dtype.kind == "S" or isinstance(value, bytes):
        return " ".join(item.decode("latin-1") for item in array.reshape(-1).tolist())
    return " ".join(
        item.decode("latin-1")
        if isinstance(item, bytes)
        else str(int(item))
        if isinstance(item, float) and item.is_integer()
        else str(item)
        for item in array.reshape(-1).tolist()
    )
