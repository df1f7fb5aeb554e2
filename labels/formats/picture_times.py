"""A table of the times of pictures: by their number, or by their name."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError
from labels.formats.exchange import NO_TIME, Collector, delimiter_of, read_text, whole_number
from labels.formats.picture_names import stem_of

NAME_COLUMNS: Final = ("name", "file_name", "filename", "file name", "file", "picture", "image")
NUMBER_COLUMNS: Final = ("frame", "frame_number", "frame_id", "frame_index", "number", "index")
UNITS: Final = {
    "t_us": Fraction(1),
    "t_ms": Fraction(1000),
    "t_s": Fraction(1_000_000),
    "t_ns": Fraction(1, 1000),
}
"""Columns of times, and microseconds in each unit."""
_TIME_NAME: Final = re.compile(r"^(?:time|timestamp|ts|stamp)[ _]?[\[(]?(?=(?:ns|us|ms|s)[\])]?$)")
LARGEST_NUMBER: Final = 100_000_000


@dataclass(frozen=True, slots=True, eq=False)
class FrameTimes:
    """When pictures were taken."""

    by_number_us: NDArray[np.int64] | None = None
    """By number from 0; `NO_TIME` for a number that is not listed."""
    by_name_us: Mapping[str, int] | None = None
    """By name, as `stem_of` makes it."""


def read_frame_times(path: Path) -> FrameTimes:
    """The times in a CSV file with a column t_us, t_ms, t_s or t_ns, and perhaps one of numbers or names.

    Raises:
        LabelError: if the file cannot be read, or does not hold together.
    """
    collector = Collector()
    text = read_text(path, collector)
    if text is None:
        raise LabelError("cannot read the frame times", got=str(collector.done().rejections[0]))
    try:
        lines = io.StringIO(text, newline=None)
        table = [[field.strip() for field in row] for row in csv.reader(lines, delimiter=delimiter_of(text)) if row]
    except csv.Error as error:
        raise LabelError("not a table of frame times", got=error, where=path) from error
    header, rows = ([_TIME_NAME.sub("t_", name.lower()) for name in table[0]], table[1:]) if table else ([], [])
    units = [name for name in UNITS if name in header]
    if len(units) != 1 or header.count(units[0]) != 1 or any(len(row) != len(header) for row in rows):
        got = ",".join(header)[:120] or "an empty file"
        expected = "a column t_us (or t_ms, t_s, t_ns), and rows of its length"
        raise LabelError("not frame times", expected=expected, got=got, where=path)
    at = header.index(units[0])
    times = [_time_us(row[at], UNITS[units[0]], f"{path}, row {number}") for number, row in enumerate(rows, start=1)]
    name = next((header.index(column) for column in NAME_COLUMNS if column in header), None)
    if name is not None:
        return FrameTimes(np.array(times, np.int64), _by_name([row[name] for row in rows], times, path))
    column = next((header.index(column) for column in NUMBER_COLUMNS if column in header), None)
    numbers = list(range(len(rows))) if column is None else _numbers([row[column] for row in rows], path)
    return FrameTimes(_by_number(numbers, times, path))


def _time_us(text: str, unit: Fraction, where: str) -> int:
    try:
        value = Fraction(text.replace(",", ".")) * unit
    except (ValueError, ZeroDivisionError) as error:
        raise LabelError("not a time", expected="a number", got=repr(text)[:80], where=where) from error
    t_us = round(value)
    if unit == 1 and value != t_us:
        raise LabelError("a time in microseconds with a fraction: is it of another unit?", got=text, where=where)
    if not -(2**62) < t_us < 2**62:
        raise LabelError("impossible time", got=text[:80], where=where)
    return t_us


def _by_name(names: Sequence[str], times: Sequence[int], path: Path) -> dict[str, int]:
    stems = [stem_of(name) for name in names]
    if len(set(stems)) != len(stems):
        raise LabelError("frame times with a name twice", expected="each picture once", where=path)
    return dict(zip(stems, times, strict=True))


def _numbers(texts: Sequence[str], path: Path) -> list[int]:
    numbers = [whole_number(text, f"a frame's number in {path.name}") for text in texts]
    if len(set(numbers)) != len(numbers) or any(not 0 <= number < LARGEST_NUMBER for number in numbers):
        raise LabelError("frame times with a number twice, or an impossible one", where=path)
    return numbers


def _by_number(numbers: Sequence[int], times: Sequence[int], path: Path) -> NDArray[np.int64]:
    found = np.full(1 + max(numbers, default=-1), NO_TIME, np.int64)
    found[list(numbers)] = times
    listed = found[found != NO_TIME]
    if np.any(np.diff(listed) < 0):
        row = int(np.flatnonzero(np.diff(listed) < 0)[0]) + 1
        got = f"{listed[row - 1]} us, then {listed[row]} us"
        raise LabelError("frame times that go back", expected="ascending times", got=got, where=path)
    return found
