"""Reading observed points of one flight from a table, and what it was taken for.

Columns t_s (or t_ms, t_us, t_ns), x_m, y_m, z_m (or _mm, _cm) say their units. Names without a unit, such as time, x,
y, z, are read in those units in which the points fly as a ball does; where several or none do, the file is refused.
The columns Timestamp,X,Y,Z are those of tt3d. Times may count from 1970.
"""

from __future__ import annotations

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
from core.physics.points_units import FEWEST, SPEEDS_MPS, Array, Motion, find_units, measure_motion, other_units

COLUMNS = ("t_s", "x_m", "y_m", "z_m")
TIMES = {"t_s": 1.0, "t_us": 1e-6, "t_ms": 1e-3, "t_ns": 1e-9}
"""Column of times -> its unit in seconds; the first that is there is taken."""
PLACES = {"_m": 1.0, "_mm": 1e-3, "_cm": 1e-2}
"""End of the name of a column of places -> its unit in metres."""
TT3D_COLUMNS: Final = ("Timestamp", "X", "Y", "Z")
"""tt3d: seconds and metres, X along the table's width, Y along its length, Z up, origin on the table's top."""
TIME_NAME: Final = re.compile(r"(?:t|time|timestamp|stamp)(?:(s|sec|seconds?|ms|us|µs|ns))?")
PLACE_NAME: Final = re.compile(r"(?:p|pos|position|ball)?([xyz])(?:world)?(m|mm|cm)?(?:world)?")
NO_NUMBER: Final = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "--"})
LARGEST_TIME_S = 1e10
"""Seconds since 1970 are 2e9; milliseconds of that age would be 2e12."""
LARGEST_PLACE_M = 100.0
"""From the middle of the table: a hall is not larger, and a table of 2.74 m in millimetres is."""
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


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (N,) in seconds, ascending, and positions (N, 3). Other columns are ignored.

    Raises:
        PointsFileError: naming the file and the row, if it cannot be read or a row is wrong.
    """
    found = read_points_file(path)
    return found.t_s, found.ps_m


def read_points_file(path: Path) -> PointsFile:
    """The points, with what was taken for granted about them.

    Raises:
        PointsFileError: naming the file and the row, if it cannot be read, a row is wrong, or a unit cannot be right.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise PointsFileError("cannot read the points", got=error.strerror, where=path) from error
    except UnicodeDecodeError as error:
        raise PointsFileError("not a CSV file", got=error, where=path) from error
    first = text.lstrip("\n\r").partition("\n")[0]
    separator = next((mark for mark in (",", ";", "\t") if mark in first), ",")
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator))
    except csv.Error as error:
        raise PointsFileError("not a CSV file", got=error, where=path) from error
    numbered = [(number, cells) for number, cells in enumerate(rows, 1) if any(cell.strip() for cell in cells)]
    header = [name.strip().lstrip("#").strip().strip('"') for name in numbered[0][1]] if numbered else []
    columns = _columns(header, path)
    notes: list[str] = []
    table, lines = _numbers(numbered[1:], columns, path, separator == ";", notes, len(header))
    table, lines = _in_order(table, lines, columns, path, notes)
    return _scaled(table, lines, columns, path, notes)


def _columns(header: list[str], path: Path) -> _Columns:
    """The four columns that are read."""
    if tuple(header) == TT3D_COLUMNS:
        return _Columns((0, 1, 2, 3), TT3D_COLUMNS, 1.0, 1.0, is_tt3d=True)
    units = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
    metres = {end[1:]: size for end, size in PLACES.items()}
    plain = [re.sub(r"[^a-zµ]", "", name.lower().replace("μ", "µ")) for name in header]
    time = next((header.index(name) for name in TIMES if name in header), None)
    if time is None:
        time = next((at for at, name in enumerate(plain) if TIME_NAME.fullmatch(name)), None)
    axes: dict[str, dict[str | None, int]] = {}
    for at, name in enumerate(plain):
        match = PLACE_NAME.fullmatch(name)
        if match:
            axes.setdefault(match[1], {}).setdefault(match[2], at)
    common = [unit for unit in (*metres, None) if all(unit in axes.get(axis, {}) for axis in "xyz")]
    if time is None or not common:
        got = ",".join(header)[:80] or "an empty file"
        raise PointsFileError("columns are missing", expected=",".join(COLUMNS), got=got, where=f"{path}, row 1")
    places = (time, *(axes[axis][common[0]] for axis in "xyz"))
    stated = TIME_NAME.fullmatch(plain[time])
    unit = units[stated[1]] if stated and stated[1] else None
    names = tuple(header[place] for place in places)
    return _Columns(places, names, unit, None if common[0] is None else metres[common[0]], is_tt3d=False)


def _numbers(
    rows: list[tuple[int, list[str]]], columns: _Columns, path: Path, decimal_commas: bool, notes: list[str], wide: int
) -> tuple[Array, NDArray[np.int64]]:
    """The cells as numbers (N, 4), in the units of the file, and the rows of the file (N,) that they stand in."""
    table: list[list[float]] = []
    lines: list[int] = []
    missing: list[PointsFileError] = []
    for line, cells in rows:
        where = f"{path}, row {line}"
        if len(cells) != wide:
            raise PointsFileError("wrong number of cells", expected=wide, got=len(cells), where=where)
        texts = [cells[place].strip() for place in columns.places]
        if decimal_commas:
            texts = [text.replace(",", ".") for text in texts]
        numbers = [_number(text, name, where) for text, name in zip(texts, columns.names, strict=True)]
        absent = next((name for number, name in zip(numbers, columns.names, strict=True) if number is None), None)
        if absent is not None:
            got = repr(texts[columns.names.index(absent)][:40])
            missing.append(
                PointsFileError(f"{absent} is not a number", expected="a finite number", got=got, where=where)
            )
            continue
        table.append([number for number in numbers if number is not None])
        lines.append(line)
    if missing and len(missing) > MOST_MISSING * len(rows):
        raise missing[0]
    if missing:
        notes.append(
            f"{len(missing)} of {len(rows)} rows without a number are left out, the first: {missing[0].details}"
        )
    if not table:
        raise PointsFileError("there are no points", where=path)
    return np.array(table, np.float64), np.array(lines)


def _number(text: str, column: str, where: str) -> float | None:
    """None for a cell that says that there is none."""
    if text.lower() in NO_NUMBER:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    if math.isnan(value):
        return None
    if math.isinf(value):
        raise PointsFileError(f"{column} is not a number", expected="a finite number", got=repr(text[:40]), where=where)
    return value


def _in_order(
    table: Array, lines: NDArray[np.int64], columns: _Columns, path: Path, notes: list[str]
) -> tuple[Array, NDArray[np.int64]]:
    """Rows by time; some may stand in another place, but not a second flight after the first."""
    steps = np.diff(table[:, 0])
    back = np.flatnonzero(steps < 0)
    if not len(back):
        return table, lines
    at, whole = int(back[0]), float(np.ptp(table[:, 0]))
    is_mixed = len(back) >= len(steps) / 4 and len(steps) >= FEWEST
    if -steps.min() > SEVERAL_FLIGHTS * whole and not is_mixed:
        raise PointsFileError(
            "times do not ascend",
            expected=f"more than {table[at, 0]:.6f}",
            got=table[at + 1, 0],
            where=f"{path}, row {lines[at + 1]}",
            remedy="a file holds one flight: write each into a file of its own",
        )
    order = np.argsort(table[:, 0], kind="stable")
    notes.append(f"the rows were not in the order of {columns.names[0]}, {len(back)} of them step back: sorted")
    return table[order], lines[order]


def _scaled(table: Array, lines: NDArray[np.int64], columns: _Columns, path: Path, notes: list[str]) -> PointsFile:
    """In seconds and metres, and checked."""
    time_s, place_m = columns.time_s, columns.place_m
    if time_s is None or place_m is None:
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
    t_s, ps_m = time_s * table[:, 0], place_m * table[:, 1:]
    _check_range(table, t_s, ps_m, lines, columns, path)
    motion = measure_motion(t_s, ps_m)
    remedy = other_units(t_s, ps_m) if motion is not None and not motion.is_a_flight else ""
    if motion is not None and (motion.speed_mps > SPEEDS_MPS[1] or "multiplied" in remedy):
        expected, got = "0.2 to 60 m/s", f"{motion.speed_mps:.3g} m/s"
        raise PointsFileError(
            f"no ball flies so: the units of {','.join(columns.names)} cannot be right",
            expected=expected,
            got=got,
            where=path,
            remedy=remedy,
        )
    _check_steps(t_s, lines, path)
    if columns.is_tt3d:
        ps_m = _from_tt3d(ps_m, notes)
        motion = measure_motion(t_s, ps_m)
    units = (
        f"{columns.names[0]} in {_unit_name(time_s, 's')}, {','.join(columns.names[1:])} in {_unit_name(place_m, 'm')}"
    )
    text = f"{len(t_s)} points over {1e3 * (t_s[-1] - t_s[0]):.0f} ms, {units}"
    if (gap_s := float(np.diff(t_s).max(initial=0.0))) > LONGEST_GAP_S:
        notes.append(f"no point for {gap_s:.1f} s: does the file hold several flights?")
    return PointsFile(t_s, ps_m, text + _words(motion, notes), tuple(notes))


def _unit_name(size: float, unit: str) -> str:
    return {1.0: "", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n"}[size] + unit


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


def _check_range(
    table: Array, t_s: Array, ps_m: Array, lines: NDArray[np.int64], columns: _Columns, path: Path
) -> None:
    for k, (values, limit) in enumerate(
        [(t_s, LARGEST_TIME_S), *((ps_m[:, axis], LARGEST_PLACE_M) for axis in range(3))]
    ):
        beyond = np.flatnonzero(~(np.abs(values) < limit))
        if not len(beyond):
            continue
        at, name = int(beyond[0]), columns.names[k]
        where, got = f"{path}, row {lines[at]}", f"{table[at, k]:.15g}"
        if k == 0:
            remedy = "name the column after its unit: t_s, t_ms, t_us or t_ns"
            raise PointsFileError(f"{name} is no time in that unit", got=got, where=where, remedy=remedy)
        remedy = "for millimetres name the columns x_mm,y_mm,z_mm, for centimetres x_cm,y_cm,z_cm"
        expected = f"at most {LARGEST_PLACE_M:g} m from the middle of the table"
        raise PointsFileError(
            f"{name} is no place at a table",
            expected=expected,
            got=got,
            where=where,
            remedy=remedy if columns.place_m == 1.0 else None,
        )


def _check_steps(t_s: Array, lines: NDArray[np.int64], path: Path) -> None:
    """Raises PointsFileError for two points at one time: a flight has one ball."""
    close = np.flatnonzero(~(t_s[1:] >= t_s[:-1] + LEAST_STEP_S))
    if len(close):
        at = int(close[0])
        expected = f"more than {t_s[at]:.6f} s"
        where = f"{path}, row {lines[at + 1]}"
        raise PointsFileError("times do not ascend", expected=expected, got=t_s[at + 1], where=where)


def _from_tt3d(ps_m: Array, notes: list[str]) -> Array:
    ps = np.stack([ps_m[:, 1], -ps_m[:, 0], ps_m[:, 2]], axis=1)
    notes.append("the columns are those of tt3d: x is its Y, along the table, and y its -X")
    if ps[-1, 0] > ps[0, 0]:
        ps[:, :2] *= -1
        notes.append("the table is turned half round, so that the ball flies towards the robot")
    return ps
