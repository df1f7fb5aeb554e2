"""Reading observed points of one flight from a table, and what it was taken for.

Columns t_s (or t_ms, t_us, t_ns), x_m, y_m, z_m (or _mm, _cm, _in, _ft) say their units. Names without a unit, such as
time, x, y, z, are read in those units in which the points fly as a ball does; where several or none do, the file is
refused.
The columns Timestamp,X,Y,Z are those of tt3d. Times may count from 1970.
"""

from __future__ import annotations

import bisect
import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RallyscopeError
from core.foreign_tables import METRES, NO_NUMBER, several_values, spelled, split_unit, with_point
from core.physics.flight_motion import (
    ABOVE_TABLE_M,
    FEWEST,
    INCH_M,
    NAMES,
    SPEEDS_MPS,
    Array,
    Motion,
    allowed_odd,
    bounce_heights,
    find_units,
    measure_motion,
    other_units,
    reachable,
)
from core.text import decode_text

COLUMNS = ("t_s", "x_m", "y_m", "z_m")
TIMES: Final = ("t_s", "t_us", "t_ms", "t_ns")
"""Columns of times before any other spelling; the first that is there is taken."""
SECONDS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Unit of time -> seconds."""
TT3D_COLUMNS: Final = ("Timestamp", "X", "Y", "Z")
"""tt3d: seconds and metres, X along the table's width, Y along its length, Z up, origin on the table's top."""
TIME_NAMES: Final = "t|time|timestamp|stamp"
LENGTHS_M: Final = {**METRES, "in": INCH_M, "inch": INCH_M, "inches": INCH_M, "ft": 0.3048, "feet": 0.3048}
"""Unit of length of a flight -> metres."""
PLACE_NAME: Final = re.compile(rf"(?:p|pos|position|ball)?([xyz])(?:world)?({'|'.join(LENGTHS_M)})?(?:world)?")
ONE_FLIGHT: Final = "a file holds one flight: write each into a file of its own"
WHOSE: Final = ("ball", "ball_id", "track", "track_id", "object_id", "flight", "flight_id")
"""Columns that tell flights apart."""
LARGEST_TIME_S = 1e10
"""Seconds since 1970 are 2e9; milliseconds of that age would be 2e12."""
LARGEST_PLACE_M = 100.0
"""From the middle of the table: a hall is not larger, and a table of 2.74 m in millimetres is."""
_FAR_OFF: Final = 10.0
"""A row at the end or the beginning that is this many times the flight's length away from it is none of the flight."""
_SEPARATORS: Final = ",;\t|"
_SEPARATOR_LINE: Final = re.compile(r"(?i)\"?sep=.?\"?")
MOST_MISSING: Final = 0.5
"""Share of the rows without a number: beyond that, the file is not what it seems."""
SEVERAL_FLIGHTS: Final = 0.2
"""Share of the whole time: a step back by more is the start of another flight."""
LONGEST_GAP_S: Final = 1.0
"""A flight over the table is shorter."""
LEAST_STEP_S: Final = 1e-6


class PointsFileError(RallyscopeError):
    """A file of points that cannot be used."""


@dataclass(frozen=True, slots=True, eq=False)
class PointsFile:
    """The points of one flight, and what they were taken for."""

    t_s: Array
    """(N,) ascending."""
    ps_m: Array
    """(N, 3) in the world's frame."""
    taken_for: str
    """Columns, units and motion, in a line."""
    notes: tuple[str, ...]
    """What was assumed or left out."""


@dataclass(frozen=True, slots=True)
class _Columns:
    """Which columns are read, and their units; None where the name does not say."""

    places: tuple[int, ...]
    names: tuple[str, ...]
    time_s: float | None
    place_m: float | None
    is_tt3d: bool


def read_points_file(path: Path) -> PointsFile:
    """The points, with what was taken for granted about them.

    Raises:
        PointsFileError: naming the file and the row, if it cannot be read, a row is wrong, or a unit cannot be right.
    """
    try:
        text = decode_text(path.read_bytes())
    except OSError as error:
        raise PointsFileError("cannot read the points", got=error.strerror, where=path) from error
    except UnicodeDecodeError as error:
        raise PointsFileError("not a CSV file", got=error.reason, where=path) from error
    lines = io.StringIO(text, newline=None).readlines()
    at, header, separator = _header(lines, path)
    columns = _columns(header, path)
    notes: list[str] = []
    try:
        cells = [(at + k, row) for k, row in enumerate(_split(lines[at:], separator), 1)]
    except csv.Error as error:
        raise PointsFileError("not a CSV file", got=error, where=path) from error
    cells = [(line, row) for line, row in cells if any(cell.strip() for cell in row) and row[0].lstrip()[:1] != "#"]
    if several := several_values(header, (row for _, row in cells), WHOSE):
        what = "several flights in one file"
        raise PointsFileError(what, expected="one value", got=several, where=path, remedy=ONE_FLIGHT)
    rows = _without_origin(_numbers(cells, columns, path, notes, len(header)), notes)
    rows = _in_order(_without_stray_times(rows, columns, path, notes), columns, path, notes)
    return _scaled(rows, columns, path, notes)


def _header(lines: list[str], path: Path) -> tuple[int, list[str], str | None]:
    """Number of the line that names the columns, the names, and what separates them; None for white space.

    That is the first that is no remark, or a remark that names them, as NumPy writes it.
    """
    for at, line in enumerate(lines, 1):
        if not line.strip() or _SEPARATOR_LINE.fullmatch(line.strip()):
            continue
        separator = max(_SEPARATORS, key=line.count)
        found = None if line.count(separator) == 0 else separator
        row = next(iter(_split([line.lstrip().lstrip("#")], found)), [])
        header = [name.strip().strip('"') for name in row]
        while header and not header[-1]:
            header.pop()
        if line.lstrip().startswith("#"):
            try:
                _columns(header, path)
            except PointsFileError:
                continue
        return at, header, found
    return len(lines), [], ","


def _split(lines: list[str], separator: str | None) -> list[list[str]]:
    """The cells of each line."""
    if separator is None:
        return [line.split() for line in lines]
    return list(csv.reader(lines, delimiter=separator))


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Rows of a file, of which odd ones are left out."""

    table: Array
    """(N, 4): time and place, in the units of the file."""
    lines: NDArray[np.int64]
    """(N,) lines of the file."""

    def those(self, which: NDArray) -> _Rows:
        """Some of the rows, by mask or index."""
        return _Rows(self.table[which], self.lines[which])


def _leave_out(odd: int, rows: int, first: PointsFileError, notes: list[str], cause: str = "") -> None:
    """Note that odd rows are left out; raise the `first` one's error, with the likeliest cause, if there are many."""
    if odd > allowed_odd(rows):
        text = f"{odd} of {rows} rows are so" + (f": {cause}" if cause else "")
        raise first if odd == 1 else PointsFileError(f"{first}; {text}")
    if odd:
        notes.append(f"{odd} of {rows} rows left out: {first.what}; {first.details}")


def _columns(header: list[str], path: Path) -> _Columns:
    """The four columns that are read."""
    if tuple(header) == TT3D_COLUMNS:
        return _Columns((0, 1, 2, 3), TT3D_COLUMNS, 1.0, 1.0, is_tt3d=True)
    plain = [re.sub(r"[^a-z]", "", spelled(name)) for name in header]
    times = [split_unit(name, TIME_NAMES, joined=True) for name in header]
    time = next((header.index(name) for name in TIMES if name in header), None)
    if time is None:
        time = next((at for at, found in enumerate(times) if found is not None), None)
    axes: dict[str, dict[str | None, int]] = {}
    for at, name in enumerate(plain):
        match = PLACE_NAME.fullmatch(name)
        if match:
            axes.setdefault(match[1], {}).setdefault(match[2], at)
    common = [unit for unit in (*LENGTHS_M, None) if all(unit in axes.get(axis, {}) for axis in "xyz")]
    if time is None or not common:
        got = ",".join(header)[:80] or "an empty file"
        raise PointsFileError("columns are missing", expected=",".join(COLUMNS), got=got, where=f"{path}, row 1")
    places = (time, *(axes[axis][common[0]] for axis in "xyz"))
    stated = times[time]
    unit = None if stated is None or stated[1] is None else SECONDS[stated[1]]
    names = tuple(header[place] for place in places)
    return _Columns(places, names, unit, None if common[0] is None else LENGTHS_M[common[0]], is_tt3d=False)


def _numbers(cells: list[tuple[int, list[str]]], columns: _Columns, path: Path, notes: list[str], wide: int) -> _Rows:
    """The cells as numbers; `wide` is how many a row has. Odd rows and those without a number are left out."""
    table: list[list[float]] = []
    lines: list[int] = []
    missing: list[PointsFileError] = []
    odd: list[PointsFileError] = []
    decimal_commas = 0
    for line, texts in cells:
        where = f"{path}, row {line}"
        # Spreadsheets end rows with empty cells.
        while len(texts) > wide and not texts[-1].strip():
            texts.pop()
        # A decimal comma between commas makes two cells of each number.
        decimal_commas += len(texts) in (2 * wide, 2 * len(columns.places))
        try:
            if len(texts) != wide:
                raise PointsFileError("wrong number of cells", expected=wide, got=len(texts), where=where)
            numbers = [
                _number(texts[place].strip(), name, where)
                for place, name in zip(columns.places, columns.names, strict=True)
            ]
        except PointsFileError as error:
            odd.append(error)
            continue
        if None in numbers:
            absent = numbers.index(None)
            got, name = repr(texts[columns.places[absent]].strip()[:40]), columns.names[absent]
            missing.append(PointsFileError(f"{name} is not a number", expected="a finite number", got=got, where=where))
            continue
        table.append([number for number in numbers if number is not None])
        lines.append(line)
    if odd:
        cause = (
            "decimal commas between commas? Separate the columns by semicolons" if 2 * decimal_commas > len(odd) else ""
        )
        _leave_out(len(odd), len(cells), odd[0], notes, cause)
    if missing and len(missing) > MOST_MISSING * len(cells):
        raise missing[0]
    if missing:
        notes.append(
            f"{len(missing)} of {len(cells)} rows without a number are left out, the first: {missing[0].details}"
        )
    if not table:
        raise PointsFileError("there are no points", where=path)
    return _Rows(np.array(table, np.float64), np.array(lines))


def _number(text: str, column: str, where: str) -> float | None:
    """None for a cell that says that there is none."""
    if text.lower() in NO_NUMBER:
        return None
    try:
        value = float(with_point(text))
    except ValueError:
        value = math.inf
    if math.isnan(value):
        return None
    if math.isinf(value):
        raise PointsFileError(f"{column} is not a number", expected="a finite number", got=repr(text[:40]), where=where)
    return value


def _without_origin(rows: _Rows, notes: list[str]) -> _Rows:
    """The rows without those at 0, 0, 0, which many trackers write where they found nothing.

    A ball is never there: the world's origin is on the table's top, and its centre a radius above.
    """
    nowhere = (rows.table[:, 1:] == 0).all(axis=1)
    if not nowhere.any() or nowhere.all():
        return rows
    notes.append(f"{int(nowhere.sum())} of {len(nowhere)} rows at 0,0,0 left out: that stands for no position")
    return rows.those(~nowhere)


def _without_stray_times(rows: _Rows, columns: _Columns, path: Path, notes: list[str]) -> _Rows:
    """The rows without a few whose times are far from those before and after them; all rows if there are more."""
    t = rows.table[:, 0]
    most = allowed_odd(len(t))
    kept = np.ones(len(t), np.bool_)
    if (np.diff(t) < 0).any():
        ascending = _longest_ascending(t)
        whole = float(np.ptp(t[ascending]))
        strays = np.setdiff1d(np.arange(len(t)), ascending)
        off = [
            k
            for k in strays
            if min(abs(t[k] - t[j]) for j in (k - 1, k + 1) if 0 <= j < len(t)) > SEVERAL_FLIGHTS * whole
        ]
        if len(strays) <= most:
            kept[off] = False
    # A stray at an end may keep the order, so there it is found by its distance.
    for count in range(1, most + 1):
        for ends in (slice(None, count), slice(-count, None)):
            rest = kept.copy()
            rest[ends] = False
            between = np.abs(t[ends][:, None] - t[rest]).min(initial=np.inf)
            if rest.sum() >= FEWEST and between > _FAR_OFF * np.ptp(t[rest]) > 0:
                kept = rest
    if not kept.all():
        at = int(np.flatnonzero(~kept)[0])
        got, where = f"{t[at]:.15g}", f"{path}, row {rows.lines[at]}"
        first = PointsFileError(f"{columns.names[0]} is far from the others", got=got, where=where)
        _leave_out(int(np.sum(~kept)), len(t), first, notes)
    return rows.those(kept)


def _longest_ascending(t: Array) -> NDArray[np.int64]:
    """Indices of the longest subsequence that never descends."""
    ends: list[float] = []
    last: list[int] = []
    before: list[int] = []
    for k, value in enumerate(t.tolist()):
        at = bisect.bisect_right(ends, value)
        before.append(last[at - 1] if at else -1)
        ends[at : at + 1] = [value]
        last[at : at + 1] = [k]
    found = [last[-1]]
    while before[found[-1]] >= 0:
        found.append(before[found[-1]])
    return np.array(found[::-1])


def _in_order(rows: _Rows, columns: _Columns, path: Path, notes: list[str]) -> _Rows:
    """Rows by time; some may stand in another place, but not a second flight after the first."""
    table, lines = rows.table, rows.lines
    steps = np.diff(table[:, 0])
    back = np.flatnonzero(steps < 0)
    if not len(back):
        return rows
    at, whole = int(back[0]), float(np.ptp(table[:, 0]))
    is_mixed = len(back) >= len(steps) / 4 and len(steps) >= FEWEST
    if -steps.min() > SEVERAL_FLIGHTS * whole and not is_mixed:
        raise PointsFileError(
            "times do not ascend",
            expected=f"more than {table[at, 0]:.6f}",
            got=table[at + 1, 0],
            where=f"{path}, row {lines[at + 1]}",
            remedy=ONE_FLIGHT,
        )
    notes.append(f"the rows were not in the order of {columns.names[0]}, {len(back)} of them step back: sorted")
    return rows.those(np.argsort(table[:, 0], kind="stable"))


def _scaled(rows: _Rows, columns: _Columns, path: Path, notes: list[str]) -> PointsFile:
    """In seconds and metres, and checked."""
    table, time_s, place_m = rows.table, columns.time_s, columns.place_m
    if time_s is None or place_m is None:  # the unit depends on the maker: microsoft/LabanotationSuite#9
        found = find_units(table, time_s, place_m)
        if len(found) != 1:
            likely = " or ".join(str(one) for one in found) or "none in which they fly as a ball does"
            raise PointsFileError(
                f"the units of {','.join(columns.names)} cannot be told",
                expected="columns named after their units, such as t_s,x_m,y_m,z_m or t_ms,x_mm,y_mm,z_mm",
                got=likely,
                where=path,
            )
        time_s, place_m = found[0].time_s, found[0].place_m
        notes.append(
            f"the names of the columns do not say all units; {found[0]}: only so the points fly as a ball does"
        )
    rows = _within_range(rows, time_s, place_m, columns, path, notes)
    rows = _without_unreachable(rows, time_s, place_m, columns, path, notes)
    t_s, ps_m = time_s * rows.table[:, 0], place_m * rows.table[:, 1:]
    motion = measure_motion(t_s, ps_m)
    remedy = other_units(t_s, ps_m) if motion is not None and not motion.is_a_flight else ""
    # Seconds in a column called t_ms, or t_ns: swift-nav/piksi_tools#629, waterloo-rocketry/omnibus#540.
    if motion is not None and (motion.speed_mps > SPEEDS_MPS[1] or "multiplied" in remedy):
        expected, got = "0.2 to 60 m/s", f"{motion.speed_mps:.3g} m/s"
        raise PointsFileError(
            f"no ball flies so: the units of {','.join(columns.names)} cannot be right",
            expected=expected,
            got=got,
            where=path,
            remedy=remedy,
        )
    kept = _without_repeated(t_s, rows, path, notes)
    t_s, ps_m = t_s[kept], ps_m[kept]
    if columns.is_tt3d:
        ps_m = _from_tt3d(ps_m, notes)
        motion = measure_motion(t_s, ps_m)
    units = (
        f"{columns.names[0]} in {_unit_name(time_s, 's')}, {','.join(columns.names[1:])} in {_unit_name(place_m, 'm')}"
    )
    text = f"{len(t_s)} points over {1e3 * (t_s[-1] - t_s[0]):.0f} ms, {units}"
    if (gap_s := float(np.diff(t_s).max(initial=0.0))) > LONGEST_GAP_S:
        notes.append(f"no point for {gap_s:.1f} s: does the file hold several flights?")
    words = _words(motion, notes)
    if (heights_m := bounce_heights(t_s, ps_m)) and min(heights_m) > ABOVE_TABLE_M:
        notes.append(f"the ball bounces at z = {heights_m[0]:.2f} m: z = 0 is to be the top of the table")
    return PointsFile(t_s, ps_m, text + words, tuple(notes))


def _unit_name(size: float, unit: str) -> str:
    return {INCH_M: "inches", LENGTHS_M["ft"]: "feet"}.get(size) or NAMES[size] + unit


def _words(motion: Motion | None, notes: list[str]) -> str:
    """The motion in words; what is odd about it goes into the notes."""
    if motion is None:
        return ""
    if not motion.is_a_flight:
        notes.append("the ball hardly moves")
        return ""
    if motion.along_y:
        notes.append("the ball flies along y: x is to be along the table's length")
    elif motion.away:
        notes.append("the ball flies towards +x, away from the robot, which plays at x < 0")
    if motion.odd_fall:
        notes.append(
            f"the ball falls with {motion.fall_mps2:.3g} m/s2, a free one with 9.8: is z up, and the unit right?"
        )
    return f"; it flies {motion.speed_mps:.1f} m/s"


def _within_range(rows: _Rows, time_s: float, place_m: float, columns: _Columns, path: Path, notes: list[str]) -> _Rows:
    """The rows with times and places that can be; raises PointsFileError for many others, whose unit is wrong."""
    values = np.abs(rows.table) * [time_s, place_m, place_m, place_m]
    beyond = ~(values < [LARGEST_TIME_S, *[LARGEST_PLACE_M] * 3])
    for k, name in enumerate(columns.names):
        found = np.flatnonzero(beyond[:, k])
        if not len(found):
            continue
        where, got = f"{path}, row {rows.lines[found[0]]}", f"{rows.table[found[0], k]:.15g}"
        if k == 0:
            what, expected = f"{name} is no time in that unit", None
            remedy = "name the column after its unit: t_s, t_ms, t_us or t_ns"
        else:
            what = f"{name} is no place at a table"
            expected = f"at most {LARGEST_PLACE_M:g} m from the middle of the table"
            remedy = "for millimetres name the columns x_mm,y_mm,z_mm, for centimetres x_cm,y_cm,z_cm"
            remedy = remedy if columns.place_m == 1.0 else None
        many = len(found) > allowed_odd(len(rows.lines))
        first = PointsFileError(what, expected=expected, got=got, where=where, remedy=remedy if many else None)
        if many:
            raise first
        _leave_out(len(found), len(rows.lines), first, notes)
    return rows.those(np.logical_not(beyond.any(axis=1)))


def _without_unreachable(
    rows: _Rows, time_s: float, place_m: float, columns: _Columns, path: Path, notes: list[str]
) -> _Rows:
    """The rows without a few points where no ball can be; all of them if there are more: their units are looked at."""
    kept = reachable(time_s * rows.table[:, 0], place_m * rows.table[:, 1:])
    odd = np.flatnonzero(~kept)
    if not 0 < len(odd) <= allowed_odd(len(kept)):
        return rows
    where, got = f"{path}, row {rows.lines[odd[0]]}", ",".join(f"{value:g}" for value in rows.table[odd[0], 1:])
    first = PointsFileError("no ball can get there from the points before and after", got=got, where=where)
    _leave_out(len(odd), len(kept), first, notes)
    return rows.those(kept)


def _without_repeated(t_s: Array, rows: _Rows, path: Path, notes: list[str]) -> NDArray[np.bool_]:
    """Which rows (N,) are not a further one of the same time: a flight has one ball. Copies of a row are none."""
    kept = np.ones(len(t_s), np.bool_)
    if not (np.diff(t_s) < LEAST_STEP_S).any():
        return kept
    last = 0
    for k in range(1, len(t_s)):
        kept[k] = t_s[k] >= t_s[last] + LEAST_STEP_S
        last = k if kept[k] else last
    repeated = np.flatnonzero(~kept)
    same = (rows.table[repeated] == rows.table[repeated - 1]).all(axis=1)
    copies, others = int(same.sum()), repeated[~same]
    # So few rows have none to spare: a copy is refused like any other repeated time.
    if copies and len(t_s) < FEWEST:
        copies, others = 0, repeated
    if copies:
        notes.append(f"{copies} of {len(t_s)} rows left out: copies of the row before")
    if len(others):
        at = int(others[0])
        first = PointsFileError(
            "times do not ascend",
            expected=f"more than {t_s[at - 1]:.6f} s",
            got=t_s[at],
            where=f"{path}, row {rows.lines[at]}",
        )
        cause = (
            "do the times have too few digits, or does the file hold several balls? A flight has one point at a time"
        )
        _leave_out(len(others), len(t_s), first, notes, cause)
    return kept


def _from_tt3d(ps_m: Array, notes: list[str]) -> Array:
    ps = np.stack([ps_m[:, 1], -ps_m[:, 0], ps_m[:, 2]], axis=1)
    notes.append("the columns are those of tt3d: x is its Y, along the table, and y its -X")
    if ps[-1, 0] > ps[0, 0]:
        ps[:, :2] *= -1
        notes.append("the table is turned half round, so that the ball flies towards the robot")
    return ps
