"""Reading observed points of one flight from a CSV with the columns t_s, x_m, y_m, z_m.

The times may be t_us, as `track` writes them, t_ms or t_ns, the places x_mm, y_mm, z_mm. Times may count from 1970.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.errors import RallyscopeError

COLUMNS = ("t_s", "x_m", "y_m", "z_m")
TIMES = {"t_s": 1.0, "t_us": 1e-6, "t_ms": 1e-3, "t_ns": 1e-9}
"""Name of a time column -> its unit in seconds; the first existing one is used."""
PLACES = {"_m": 1.0, "_mm": 1e-3}
"""End of the name of a column of places -> its unit in metres."""
LARGEST_TIME_S = 1e10
"""Seconds since 1970 are 2e9; milliseconds of that age would be 2e12."""
LARGEST_PLACE_M = 100.0
"""Largest distance from the middle of the table: larger than a hall, smaller than 2.74 m in millimetres."""


class PointsFileError(RallyscopeError):
    """A file of points that cannot be used."""


def read_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (N,) in seconds, ascending, and positions (N, 3). Other columns are ignored.

    Raises:
        PointsFileError: naming the file and the row, if it cannot be read or a row is wrong.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return _parse(file, path)
    except OSError as error:
        raise PointsFileError("cannot read the points", got=error.strerror, where=path) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise PointsFileError("not a CSV file", got=error, where=path) from error


def _parse(lines: Iterable[str], path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    reader = csv.reader(lines)
    header = [name.strip() for name in next(reader, [])]
    columns = _columns(header, path)
    places = [header.index(name) for name in columns]
    rows: list[list[float]] = []
    for cells in reader:
        if not cells:
            continue
        where = f"{path}, row {reader.line_num}"
        if len(cells) != len(header):
            raise PointsFileError("wrong number of cells", expected=len(header), got=len(cells), where=where)
        rows.append([_number(cells[place], name, where) for place, name in zip(places, columns, strict=True)])
        if len(rows) > 1 and not rows[-1][0] >= rows[-2][0] + 1e-6:
            expected = f"more than {rows[-2][0]:.6f} s"
            raise PointsFileError("times do not ascend", expected=expected, got=rows[-1][0], where=where)
    if not rows:
        raise PointsFileError("there are no points", where=path)
    table = np.array(rows)
    return table[:, 0], table[:, 1:]


def _columns(header: list[str], path: Path) -> tuple[str, ...]:
    """Names of the four columns that are read."""
    time = next((name for name in TIMES if name in header), None)
    end = next((end for end in PLACES if all(f"{axis}{end}" in header for axis in "xyz")), None)
    if time is None or end is None:
        got = ",".join(header)[:80] or "an empty file"
        raise PointsFileError("columns are missing", expected=",".join(COLUMNS), got=got, where=f"{path}, row 1")
    return (time, *(f"{axis}{end}" for axis in "xyz"))


def _number(text: str, column: str, where: str) -> float:
    """Value in seconds or metres."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise PointsFileError(f"{column} is not a number", expected="a finite number", got=repr(text[:40]), where=where)
    if column in TIMES:
        if not abs(value * TIMES[column]) < LARGEST_TIME_S:
            remedy = "name the column after its unit: t_s, t_ms, t_us or t_ns"
            raise PointsFileError(f"{column} is no time in that unit", got=repr(text[:40]), where=where, remedy=remedy)
        return value * TIMES[column]
    value *= PLACES[column[1:]]
    if not abs(value) < LARGEST_PLACE_M:
        remedy = "for millimetres name the columns x_mm,y_mm,z_mm" if column.endswith("_m") else None
        expected = f"at most {LARGEST_PLACE_M:g} m from the middle of the table"
        raise PointsFileError(
            f"{column} is no place at a table", expected=expected, got=repr(text[:40]), where=where, remedy=remedy
        )
    return value
