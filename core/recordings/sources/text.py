"""Events as text: one event a line, separated by commas, semicolons, tabs or spaces.

The first line may name the columns in any order (t, x, y, p and their usual spellings; t_us and t_s tell the unit).
Without names the order is t x y p, x y p t or x y t p, recognised by the values. Times with fractions count seconds,
whole ones microseconds. Lines that begin with # or % are skipped.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.checking import check_table
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource
from core.recordings.sources.table_columns import addresses_from_column, counts_seconds, find_columns, times_us
from core.recordings.sources.table_order import TableOrder, guess_columns

_LINES: Final = 100_000
_SAMPLE_LINES: Final = 2_000


@dataclass(frozen=True, slots=True)
class _Layout:
    separator: str | None
    """None for white space."""
    skip: int
    """Lines before the first event."""
    order: TableOrder


def open_text(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file.

    Raises:
        RecordingError: if its lines are not events.
    """
    layout = _find_layout(path)
    return [make_source(path, "camera", "text", sensor, lambda report: _decode(path, layout, report), check_table)]


def _open(path: Path) -> TextIO:
    return path.open(encoding="utf-8", errors="replace")


def _find_layout(path: Path) -> _Layout:
    with _open(path) as file:
        lines = list(itertools.islice(file, _SAMPLE_LINES))
    skip = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), len(lines))
    if skip == len(lines):
        raise RecordingError("the text file holds no events", where=path)
    first = lines[skip]
    separator = next((mark for mark in ",;\t" if mark in first), None)
    names = [name.strip() for name in first.split(separator)]
    if any(_is_number(name) for name in names):
        sample, _ = _parse(lines[skip:], separator, len(names))
        if len(names) != 4 or not len(sample):
            got = first.strip()[:60]
            raise RecordingError("the text is not events", expected="four numbers a line", got=repr(got), where=path)
        return _Layout(separator, skip, guess_columns(sample, where=str(path)))
    try:
        places = find_columns(names, where=str(path))
    except RecordingError as error:
        got = first.strip()[:60]
        raise RecordingError(
            "the text is not events", expected="four numbers a line, or column names", got=repr(got), where=path
        ) from error
    seconds = counts_seconds(names[places["t"]])
    if seconds is None:
        sample, _ = _parse(lines[skip + 1 :], separator, len(names))
        times = sample[:, places["t"]]
        seconds = bool((times != np.floor(times)).any())
    return _Layout(separator, skip + 1, TableOrder(places, seconds))


def _decode(path: Path, layout: _Layout, report: DecodeReport) -> Iterator[Columns]:
    size = max(1, path.stat().st_size)
    width = max(4, max(layout.order.places.values()) + 1)
    number = layout.skip
    read = 0
    with _open(path) as file:
        for _ in range(layout.skip):
            read += len(file.readline())
        while lines := list(itertools.islice(file, _LINES)):
            table, good = _parse(lines, layout.separator, width)
            if _is_cut_short(lines[-1], table, layout.order):
                table, good = table[:-1], len(lines) - 1
            if len(table):
                yield _columns(table, layout.order)
            if good < len(lines):
                got = lines[good].strip()[:40]
                report.notes.append(f"{path.name}: stopped at line {number + good + 1:,}: {got!r} is not an event.")
                return
            number += len(lines)
            read += sum(map(len, lines))
            report.share = read / size


def _is_cut_short(line: str, table: NDArray, order: TableOrder) -> bool:
    """Whether the line ends within its time, which then has too few digits."""
    t = table[:, order.places["t"]]
    return not line.endswith("\n") and len(t) > 1 and t[-1] < t[-2]


def _columns(table: NDArray, order: TableOrder) -> Columns:
    t, x, y, p = (table[:, order.places[name]] for name in ("t", "x", "y", "p"))
    return Columns(times_us(t, seconds=order.seconds), addresses_from_column(x), addresses_from_column(y), p > 0)


def _parse(lines: list[str], separator: str | None, width: int) -> tuple[NDArray[np.float64], int]:
    """The numbers of the lines up to the first that is not an event, and how many lines were good."""
    try:
        table = np.loadtxt(lines, np.float64, delimiter=separator, ndmin=2, comments=("#", "%"), usecols=range(width))
        if bool((np.abs(table) < 2**53).all()):
            return table, len(lines)
    except ValueError:
        pass
    good = next((i for i, line in enumerate(lines) if not _is_event(line, separator, width)), len(lines))
    rows = [line for line in lines[:good] if line.strip() and line.lstrip()[0] not in "#%"]
    if not rows:
        return np.empty((0, width)), good
    return np.loadtxt(rows, np.float64, delimiter=separator, ndmin=2, usecols=range(width)), good


def _is_event(line: str, separator: str | None, width: int) -> bool:
    if not line.strip() or line.lstrip()[0] in "#%":
        return True
    fields = line.split(separator)
    return len(fields) >= width and all(_is_number(field) and abs(float(field)) < 2**53 for field in fields)


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False
