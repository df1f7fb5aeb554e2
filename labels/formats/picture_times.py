"""The times of pictures: from a table of them, by their number or by their name."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError
from core.foreign_tables import split_unit, with_point
from labels.formats.exchange import NO_TIME, Collector, ImportContext, read_text, whole_number, without_remarks
from labels.formats.picture_names import PictureNumbers, other_camera_in, own_time, stem_of

NAME_COLUMNS: Final = ("name", "file_name", "filename", "file name", "file", "picture", "image")
NUMBER_COLUMNS: Final = ("frame", "frame_number", "frame_id", "frame_index", "number", "index")
_TIME: Final = "t|time|timestamp|ts|stamp"
_EXACT_US: Final = {"ns": Fraction(1, 1000), "us": Fraction(1), "ms": Fraction(1000), "s": Fraction(1_000_000)}
"""Microseconds in each unit, so that no digit of a long time is lost."""
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
        text, delimiter = without_remarks(text)
        lines = io.StringIO(text, newline=None)
        table = [[field.strip() for field in row] for row in csv.reader(lines, delimiter=delimiter) if row]
    except csv.Error as error:
        raise LabelError("not a table of frame times", got=error, where=path) from error
    header, rows = ([name.lower() for name in table[0]], table[1:]) if table else ([], [])
    # Only with a unit: a guess would shift all labels.
    columns = [(at, found[1]) for at, name in enumerate(header) if (found := split_unit(name, _TIME)) and found[1]]
    if len(columns) != 1 or any(len(row) != len(header) for row in rows):
        got = ",".join(header)[:120] or "an empty file"
        expected = "a column t_us (or t_ms, t_s, t_ns), and rows of its length"
        raise LabelError("not frame times", expected=expected, got=got, where=path)
    ((at, unit),) = columns
    times = [_time_us(row[at], _EXACT_US[unit], f"{path}, row {number}") for number, row in enumerate(rows, start=1)]
    name = next((header.index(column) for column in NAME_COLUMNS if column in header), None)
    if name is not None:
        return FrameTimes(np.array(times, np.int64), _by_name([row[name] for row in rows], times, path))
    column = next((header.index(column) for column in NUMBER_COLUMNS if column in header), None)
    numbers = list(range(len(rows))) if column is None else _numbers([row[column] for row in rows], path)
    return FrameTimes(_by_number(numbers, times, path))


def _time_us(text: str, unit: Fraction, where: str) -> int:
    try:
        value = Fraction(with_point(text)) * unit
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


@dataclass(frozen=True, slots=True, eq=False)
class PictureTimes:
    """The times of the pictures of one import, from all their names together."""

    context: ImportContext
    numbers: PictureNumbers

    @classmethod
    def of(cls, names: Iterable[str], context: ImportContext) -> PictureTimes:
        """The times of the pictures with these names."""
        return cls(context, PictureNumbers(names))

    def check_camera(self, picture: str) -> None:
        """Raises LabelError if a picture is one of another camera of the recording."""
        other = other_camera_in(picture, self.context.camera, self.context.other_cameras)
        if other is not None:
            expected = f"one of {self.context.camera!r}"
            raise LabelError(f"a picture of camera {other!r}", expected=expected, got=repr(picture[:200]))

    def time_of(self, picture: str, index: int | None = None) -> int:
        """By our own time in the name, by the table of names, by the tool's own index, or by a number in the name.

        Raises:
            LabelError: if nothing tells, or the tool's index and the name contradict each other.
        """
        stem = stem_of(picture)
        self.numbers.refuse_copies(picture)
        self.check_camera(picture)
        ours = own_time(stem)
        if ours is not None:
            return ours
        by_name = self.context.times_by_name
        if by_name is not None:
            if stem not in by_name:
                raise LabelError("a picture that is not in --frame-times", got=repr(picture[:200]))
            return by_name[stem]
        try:
            number = self.numbers.number_of(picture)
        except LabelError:
            if index is None:
                raise
            return self.context.time_of_frame(index)
        times = self.context.frame_times_us
        if times is not None and index is None:
            check_numbers(self.numbers.known, times)
        if index is not None and index != number:
            raise LabelError(
                "the tool's index of a picture is not the number in its name",
                expected=index,
                got=repr(picture[:200]),
                remedy="--frame-times with the columns name,t_us tells",
            )
        return self.context.time_of_frame(number)


def check_numbers(numbers: Sequence[int], times_us: NDArray[np.int64]) -> None:
    """Hold the numbers of pictures against those of a table of times, which may count from another number.

    Raises:
        LabelError: if pictures 1 to N meet N times from 0, pictures from 0 a table from 1, or numbers with gaps as many
            times as pictures: each picture would have the time of another (favyen/miris#4). `numbers` ascend.
    """
    if not numbers:
        return
    listed = np.flatnonzero(times_us != NO_TIME)
    first, last = (int(listed[0]), int(listed[-1])) if len(listed) else (0, -1)
    what = ""
    if len(listed) > 1 and first == 0 and numbers[0] >= 1 and numbers[-1] == last + 1:
        what = "pictures seem to be numbered from 1, and times are counted from 0"
    elif first == 1 and numbers[0] == 0:
        what = "pictures are numbered from 0, and times are counted from 1"
    elif len(listed) == last + 1 == len(numbers) > 1 and numbers[-1] > last and numbers[-1] - numbers[0] > last:
        what = "as many times as pictures, whose numbers have gaps: the table seems to list them in their order"
    if what:
        raise LabelError(
            what,
            expected=f"{first} to {last}",
            got=f"{numbers[0]} to {numbers[-1]}",
            remedy="--frame-times with the columns frame,t_us or name,t_us tells",
        )
