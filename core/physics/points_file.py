"""Reading observed points of one flight from a CSV with the columns t_s (or t_us, as `track` writes), x_m, y_m, z_m."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.errors import RallyscopeError

COLUMNS = ("t_s", "x_m", "y_m", "z_m")
MICROSECONDS = "t_us"
LARGEST = 1e9
"""Neither a time in seconds (30 years) nor a place is larger."""


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
    in_us = COLUMNS[0] not in header and MICROSECONDS in header
    columns = (MICROSECONDS, *COLUMNS[1:]) if in_us else COLUMNS
    if any(name not in header for name in columns):
        got = ",".join(header)[:80] or "an empty file"
        raise PointsFileError("columns are missing", expected=",".join(COLUMNS), got=got, where=f"{path}, row 1")
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


def _number(text: str, column: str, where: str) -> float:
    """In seconds or metres."""
    try:
        value = float(text) * (1e-6 if column == MICROSECONDS else 1.0)
    except ValueError:
        value = math.nan
    if not abs(value) < LARGEST:
        raise PointsFileError(f"{column} is not a number", expected="a finite number", got=repr(text[:40]), where=where)
    return value
