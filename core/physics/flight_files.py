"""Recorded flights from files: points in our world frame, or as the tt3d project writes them."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from core.errors import RecordingError
from core.physics.fit_flights import RecordedFlight
from core.physics.points_file import read_points

FOREIGN_HEADER = "Timestamp,X,Y,Z"
"""tt3d: seconds and metres, X along the table's width, Y along its length, Z up, origin on the table's top."""
FEWEST = 12


def read_flight(path: Path) -> RecordedFlight:
    """One flight. A tt3d flight is turned into the world frame, and half round if it flies towards +x.

    Raises:
        RallyscopeError: if it cannot be read, or has too few points.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            foreign = file.readline().strip() == FOREIGN_HEADER
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError("cannot read the flight", got=error, where=path) from error
    if foreign:
        t_s, ps = _read_foreign(path)
    else:
        t_s, ps = read_points(path)
    if len(t_s) < FEWEST:
        raise RecordingError("too short a flight", expected=f"{FEWEST} points or more", got=len(t_s), where=path)
    return RecordedFlight(path.stem, t_s - t_s[0], ps)


def _read_foreign(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        with warnings.catch_warnings(action="ignore"):  # of an empty file; it is refused below
            table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except ValueError as error:
        raise RecordingError("not a table of numbers", got=error, where=path) from error
    if table.shape[1:] != (4,) or not np.isfinite(table).all() or not (np.diff(table[:, 0]) > 0).all():
        raise RecordingError("not a flight", expected="ascending times and finite places", where=path)
    ps = np.stack([table[:, 2], -table[:, 1], table[:, 3]], axis=1)
    if ps[-1, 0] > ps[0, 0]:
        ps[:, :2] *= -1
    return table[:, 0], ps
