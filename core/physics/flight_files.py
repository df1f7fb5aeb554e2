"""Recorded flights from files: points in our world frame, or as the tt3d project writes them."""

from __future__ import annotations

from pathlib import Path

from core.errors import RecordingError
from core.physics.fit_flights import RecordedFlight
from core.physics.points_file import PointsFile, read_points_file

FEWEST = 12


def read_flight(path: Path) -> RecordedFlight:
    """One flight. A tt3d flight is turned into the world frame, and half round if it flies towards +x.

    Raises:
        RallyscopeError: if it cannot be read, or has too few points.
    """
    return read_flight_file(path)[0]


def read_flight_file(path: Path) -> tuple[RecordedFlight, PointsFile]:
    """One flight, and what its file was taken for.

    Raises:
        RallyscopeError: if it cannot be read, or has too few points.
    """
    found = read_points_file(path)
    if len(found.t_s) < FEWEST:
        got = len(found.t_s)
        raise RecordingError("too short a flight", expected=f"{FEWEST} points or more", got=got, where=path)
    return RecordedFlight(path.stem, found.t_s - found.t_s[0], found.ps_m), found
