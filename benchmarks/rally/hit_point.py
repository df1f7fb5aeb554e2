"""The newest hit point that a robot has, by the time that is left until the ball is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from benchmarks.machine import two_digits
from core.history.lead_time import true_crossings
from core.recordings import BallTruth
from core.trajectory.prediction import HitPlane

LEADS_MS: Final = (400, 300, 200, 150, 100, 50, 25)
"""Times before the impact; a racket that moves 0.5 m needs about 200 ms."""
HIT_POINT: Final = """The newest hit point that is known so long before the ball is at the plane: median distance from
where it comes through, mm (balls with one)."""
LEAD_TITLES: Final = tuple(f"{lead} ms" for lead in LEADS_MS)


def newest_hit_errors_mm(
    told: Sequence[tuple[int, HitPlane]], truth: BallTruth, leads_ms: Sequence[int] = LEADS_MS
) -> list[float | None]:
    """Distance in the plane between the newest hit point and the true one, mm, for each time before the impact.

    None where none was known by then, and all None if the ball never came through the plane.

    Args:
        told: when each hit point was known, us, and the point; ascending.
        truth: the ball of this flight.
        leads_ms: times before the ball is at the plane.
    """
    if not told:
        return [None] * len(leads_ms)
    times_us, places_m = true_crossings(truth, round(float(told[-1][1].p_world_m[0]), 4))
    if not len(times_us):
        return [None] * len(leads_ms)
    t_us, place_m = int(times_us[0]), places_m[0]
    found: list[float | None] = []
    for lead_ms in leads_ms:
        asked_us = t_us - 1000 * lead_ms
        there = [hit for known_us, hit in told if known_us <= asked_us]
        off_m = None if not there else float(np.linalg.norm(there[-1].p_world_m[1:] - place_m[1:]))
        found.append(None if off_m is None else 1e3 * off_m)
    return found


def hit_point_rows(balls: Sequence[Sequence[float | None]]) -> list[dict[str, object]]:
    """For each of `LEADS_MS`: of how many balls a hit point was known, and its error, median and p95 in mm."""
    rows: list[dict[str, object]] = []
    for lead_ms, errors in zip(LEADS_MS, zip(*balls, strict=True), strict=True):
        known = [error for error in errors if error is not None]
        median, p95 = np.percentile(known, (50, 95)).tolist() if known else (None, None)
        rows.append({"lead_ms": lead_ms, "told": len(known), "median_mm": median, "p95_mm": p95})
    return rows


def hit_cells(rows: Sequence[Mapping[str, object]]) -> list[list[str]]:
    """Cells of a table with a row a speed, from rows of `hit_point_rows` with their `speed_mps`."""
    speeds = dict.fromkeys(row["speed_mps"] for row in rows)
    return [
        [
            f"{speed:g}",
            *(f"{two_digits(row['median_mm'])} ({row['told']})" for row in rows if row["speed_mps"] == speed),
        ]
        for speed in speeds
    ]
