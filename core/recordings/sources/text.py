"""Events as text: one event a line, separated by commas, semicolons, bars, tabs or spaces.

The first line may name the columns in any order (t, x, y, p and their usual spellings; t_us and t_s tell the unit).
Without names the order is told from the values, and said. Lines that begin with # or % are skipped, but for the size of
the sensor and the names of the columns that they may state.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final, TextIO

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.foreign_tables import allowed_odd
from core.recordings.sources.making import make_table_source
from core.recordings.sources.source import DecodeReport, EventSource, RawColumns
from core.recordings.sources.table_columns import (
    camera_column,
    find_columns,
    refuse_several_cameras,
    refuse_split_time,
    size_in_names,
    unit_of_name,
)
from core.recordings.sources.values.stated_sizes import size_in_text, size_of
from core.recordings.sources.values.table_order import guess_columns
from core.text import encoding_of

_LINES: Final = 100_000
_SAMPLE_LINES: Final = 2_000


_COMMA_IN_QUOTES: Final = re.compile(r"(?<=[\"'])(-?\d+),(\d+)(?=[\"'])")
_NUMBER_IN_QUOTES: Final = re.compile(r"(?<=[\"'])-?\d+(?:,\d+)+(?=[\"'])")
_THOUSANDS: Final = re.compile(r"-?[1-9]\d{0,2}(,\d{3})+")
_CLOCK: Final = re.compile(r"(?<![\d:T-])(?<!\d )\d{1,2}:\d\d:\d\d(?!:)")
"""A time of day without a date."""
_DATE: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_BRACKETS: Final = str.maketrans("", "", "()[]{}\"'")
_HEAD_BYTES: Final = 1 << 16


@dataclass(frozen=True, slots=True)
class _Layout:
    separator: str | None
    """None for white space."""
    skip: int
    """Lines before the first event."""
    places: dict[str, int]
    unit: str | None
    sensor: SensorSize | None
    decimal_comma: bool
    words: int | None = None
    """The column that holds words for the polarities, such as ON."""
    dates: int | None = None
    """The column that holds dates with the time of day."""
    thousands: bool = False
    """Whether commas within quotes part thousands."""
    assumed: tuple[str, ...] = ()
    """What is said of columns without names."""
    camera: int | None = None
    """The column that says which camera an event is of."""


def open_text(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file.

    Raises:
        RecordingError: if its lines are not events.
    """
    layout = _find_layout(path)
    size = sensor or layout.sensor
    return [
        make_table_source(
            path, "camera", "text", size, lambda report: _decode(path, layout, report),
            unit=layout.unit, assumed=layout.assumed,
        )
    ]  # fmt: skip


def is_text_below_comments(path: Path) -> bool:
    """Whether lines of text follow the lines that begin with #."""
    with path.open("rb") as file:
        rest = next((line for line in itertools.islice(file, _SAMPLE_LINES) if not line.startswith(b"#")), b"")
    return len(rest) > 1 and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in rest)


def _open(path: Path) -> TextIO:
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return path.open(encoding=encoding_of(head, whole=len(head) < _HEAD_BYTES), errors="replace")


def _is_comment(line: str) -> bool:
    return not line.strip() or line.lstrip()[0] in "#%"


def _is_remark(line: str) -> bool:
    """Whether a line before the events is a remark in another dialect, and no names or numbers."""
    words = line.strip()
    if re.fullmatch(r"(?i)\"?sep=.?\"?", words):  # Excel's own
        return True
    return words.startswith(("//", ";", "!", "--")) and not _is_number(words.lstrip("/;!- ").split(",")[0])


def _find_layout(path: Path) -> _Layout:
    with _open(path) as file:
        lines = list(itertools.islice(file, _SAMPLE_LINES))
    skip = next((i for i, line in enumerate(lines) if not _is_comment(line)), len(lines))
    while skip < len(lines) and _is_remark(lines[skip]):
        skip += 1
    if skip == len(lines):
        raise RecordingError("the text file holds no events", where=path)
    sensor = size_in_text(lines[:skip])
    words = re.split(r"[\s,;x]+", lines[skip].strip())
    if len(words) == 2 and all(word.isdigit() for word in words):  # rpg_e2vid: the first line is the size
        sensor, skip = size_of(*words), skip + 1
    first = lines[skip] if skip < len(lines) else ""
    separator, decimal_comma = _separator(first, lines[skip + 1] if skip + 1 < len(lines) else first)
    layout = _Layout(separator, skip, {}, None, sensor, decimal_comma, thousands=_part_thousands(lines[skip + 1 :]))
    names = [name.strip().strip("\"'") for name in first.strip().strip("()[]").split(separator)]
    got = repr(first.strip()[:60])
    fields = _plain(first, layout).split(separator)
    if any(_is_number(field) for field in fields):
        while len(names) > 4 and not names[-1]:
            names.pop()  # a separator at the end of each line
        dates = _place_of_date(fields)
        layout = replace(layout, words=_place_of_words(fields[: len(names)], dates), dates=dates)
        commented = _commented_names(lines[:skip], len(names))
        if commented is not None:
            places = find_columns(commented, where=str(path))
            return replace(layout, places=places, unit=_unit(layout, places, commented[places["t"]]))
        sample, _ = _parse(_cleaned(lines[skip:], layout, {}), separator, range(len(names)))
        if len(names) != 4 or not len(sample):
            raise RecordingError("the text is not events", expected="four numbers a line", got=got, where=path)
        order = guess_columns(sample, where=str(path))
        return replace(
            layout, places=order.places, unit=_unit(layout, order.places, ""), assumed=(order.note(path.name),)
        )
    try:
        places = find_columns(names, where=str(path))
    except RecordingError as error:
        expected = "four numbers a line, or column names"
        raise RecordingError("the text is not events", expected=expected, got=got, where=path) from error
    second = _plain(lines[skip + 1], layout).rstrip("\r\n").split(separator) if skip + 1 < len(lines) else names
    while len(second) > len(names) and not second[-1].strip():
        second.pop()  # a separator at the end of each line
    if len(second) > len(names):
        raise RecordingError(
            "the lines have more fields than the first line has names",
            expected=f"{len(names)} fields: {', '.join(names)}",
            got=repr(lines[skip + 1].strip()[:60]),
            where=path,
            remedy="name every column; numbers with decimal commas need another separator",
        )

    def column_at(place: int) -> NDArray:
        return _parse(_cleaned(lines[skip + 1 :], layout, {}), separator, [place])[0].reshape(-1)

    refuse_split_time(names, places["t"], column_at, path)
    dates = _place_of_date(second)
    layout = replace(layout, dates=dates if dates == places["t"] else None)
    word = second[places["p"]].strip() if len(second) > places["p"] else ""
    others = [name for place, name in enumerate(names) if place not in places.values() and not _is_index(name)]
    return replace(
        layout, skip=skip + 1, places=places, unit=_unit(layout, places, names[places["t"]]),
        sensor=sensor or size_in_names(names), camera=camera_column(names),
        words=places["p"] if word and not _is_number(word) else None,
        assumed=(f"{path.name}: the columns {', '.join(others)} are not read.",) if others else (),
    )  # fmt: skip


def _is_index(name: str) -> bool:
    """Whether a column only counts the rows."""
    return name.lower() in ("", "index", "idx", "id", "event_id", "#", "no", "n") or name.lower().startswith("unnamed")


def _unit(layout: _Layout, places: dict[str, int], name: str) -> str | None:
    """Unit of the times: dates become microseconds since 1970, which a float64 holds exactly."""
    return "us" if layout.dates == places["t"] else unit_of_name(name)


def _place_of_date(fields: list[str]) -> int | None:
    return next((place for place, field in enumerate(fields) if _us_of_date(field) is not None), None)


def _us_of_date(text: str) -> int | None:
    """Microseconds since 1970 of a date with a time of day as pandas and ISO 8601 write it, in UTC unless it says."""
    text = text.strip()
    if not _DATE.match(text):
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (moment.replace(tzinfo=moment.tzinfo or UTC) - _EPOCH) // timedelta(microseconds=1)


def _part_thousands(lines: list[str]) -> bool:
    """Whether commas in quotes part thousands: two in a number, or lines with and without in one file."""
    quoted = [_NUMBER_IN_QUOTES.findall(line) for line in lines]
    numbers = [number for found in quoted for number in found]
    if not numbers or not all(_THOUSANDS.fullmatch(number) for number in numbers):
        return False
    return any(number.count(",") > 1 for number in numbers) or not all(quoted)


def _place_of_words(fields: list[str], dates: int | None) -> int | None:
    """The one field that is neither a number nor the date."""
    places = [place for place, field in enumerate(fields) if place != dates and not _is_number(field)]
    return places[0] if len(places) == 1 and fields[places[0]].strip() else None


def _commented_names(lines: list[str], count: int) -> list[str] | None:
    """The names of the columns if the last comment before the numbers lists them, such as `# t x y p`."""
    for line in reversed(lines):
        words = line.strip().lstrip("#% \t")
        for names in (re.split(r"\s*[,;\t]\s*", words), words.split()):
            if len(names) == count:
                try:
                    find_columns(names, where="")
                except RecordingError:
                    continue
                return names
    return None


def _separator(first: str, second: str) -> tuple[str | None, bool]:
    """What separates the columns, and whether numbers have a decimal comma."""
    for mark in ";|":
        if mark in first:
            return mark, "," in second
    if "\t" in first and len(first.split("\t")) >= min(4, len(first.split())):
        return "\t", "," in second
    if "," in second and len(second.split(",")) < 4 <= len(second.split()):
        return None, True
    return ("," if "," in first else None), False


def _cleaned(lines: list[str], layout: _Layout, codes: dict[str, int]) -> list[str]:
    """The lines with plain numbers: no quotes, no decimal commas, and for a word its number in `codes`, which grows."""
    plain = _plain("".join(lines), layout).splitlines(keepends=True)
    if layout.dates is not None:
        plain = [_timed(line, layout.dates, layout.separator) for line in plain]
    if layout.words is None:
        return plain
    return [_coded(line, layout.words, layout.separator, codes) for line in plain]


def _timed(line: str, place: int, separator: str | None) -> str:
    fields = line.split(separator)
    t_us = _us_of_date(fields[place]) if len(fields) > place else None
    if t_us is None:
        return line
    fields[place] = str(t_us)
    return (separator or " ").join(fields) + ("\n" if place == len(fields) - 1 or separator is None else "")


def _coded(line: str, place: int, separator: str | None, codes: dict[str, int]) -> str:
    fields = line.split(separator)
    if _is_comment(line) or len(fields) <= place:
        return line
    fields[place] = str(codes.setdefault(fields[place].strip(), len(codes)))
    return (separator or " ").join(fields) + ("\n" if place == len(fields) - 1 or separator is None else "")


def _plain(text: str, layout: _Layout) -> str:
    """The text without quotes, brackets and decimal commas."""
    if '"' in text or "'" in text or text.lstrip()[:1] in ("(", "["):
        if layout.thousands:
            text = _NUMBER_IN_QUOTES.sub(lambda found: found[0].replace(",", ""), text)
        text = _COMMA_IN_QUOTES.sub(r"\1.\2", text).translate(_BRACKETS)
    if layout.decimal_comma:
        text = text.replace(",", ".")
    return text.replace("\N{MINUS SIGN}", "-")


def _decode(path: Path, layout: _Layout, report: DecodeReport) -> Iterator[RawColumns]:
    size = max(1, path.stat().st_size)
    columns = [layout.places[name] for name in ("t", "x", "y", "p")]
    cameras = set[str]()
    number, read, rows, odd = layout.skip, 0, 0, 0
    first_odd = ""
    codes: dict[str, int] = {}
    with _open(path) as file:
        for _ in range(layout.skip):
            read += len(file.readline())
        while lines := list(itertools.islice(file, _LINES)):
            cleaned = _cleaned(lines, layout, codes)
            table, bad = _parse(cleaned, layout.separator, columns)
            # A number that lost its last digits is still a number.
            if _is_cut_short(lines[-1], table):
                table = table[:-1]
            if layout.camera is not None:
                _check_one_camera(cleaned, set(bad), layout, cameras, path)
            if bad and not odd:
                first_odd = f"line {number + bad[0] + 1:,}: {lines[bad[0]].strip()[:40]!r}"
            odd += len(bad)
            rows += len(table)
            if len(table):
                t, x, y, p = table.T
                yield RawColumns(t, x, y, p if layout.words is None else np.array(list(codes))[p.astype(np.intp)])
            number += len(lines)
            read += sum(map(len, lines))
            report.share = min(1.0, read / size)
    if odd > allowed_odd(rows + odd):
        what = f"{odd:,} of {rows + odd:,} lines are not events"
        remedy = "write the date before the time of day, as 2025-01-31 12:00:00.5" if _CLOCK.search(first_odd) else ""
        raise RecordingError(what, got=f"first {first_odd}", where=path, remedy=remedy)
    note = f"{path.name}: {odd:,} lines are not events and were left out; first {first_odd}."
    report.leave_out("lines that are no events", odd, note)


def _check_one_camera(lines: list[str], odd: set[int], layout: _Layout, cameras: set[str], path: Path) -> None:
    """Raise RecordingError if the events are of more than one camera; `cameras`, those of the lines before, grows."""
    place = layout.camera or 0
    for number, line in enumerate(lines):
        fields = line.split(layout.separator)
        if number not in odd and not _is_comment(line) and len(fields) > place:
            cameras.add(fields[place].strip())
    refuse_several_cameras(cameras, path)


def _is_cut_short(line: str, table: NDArray) -> bool:
    """Whether the line ends within its time, which then has too few digits."""
    t = table[:, 0]
    return not line.endswith("\n") and len(t) > 1 and t[-1] < t[-2]


def _parse(lines: list[str], separator: str | None, columns: Sequence[int]) -> tuple[NDArray[np.float64], list[int]]:
    """The numbers in these columns of the lines that are events (N, columns), and which lines are none."""
    try:
        table = np.loadtxt(lines, np.float64, delimiter=separator, ndmin=2, comments=("#", "%"), usecols=columns)
        if bool(np.isfinite(table).all()):
            return table, []
    except ValueError:
        pass
    bad = [i for i, line in enumerate(lines) if not _is_event(line, separator, columns)]
    odd = set(bad)
    rows = [line for i, line in enumerate(lines) if i not in odd and not _is_comment(line)]
    if not rows:
        return np.empty((0, len(columns))), bad
    return np.loadtxt(rows, np.float64, delimiter=separator, ndmin=2, usecols=columns), bad


def _is_event(line: str, separator: str | None, columns: Sequence[int]) -> bool:
    if _is_comment(line):
        return True
    fields = line.split(separator)
    return len(fields) > max(columns) and all(_is_number(fields[place]) for place in columns)


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False
