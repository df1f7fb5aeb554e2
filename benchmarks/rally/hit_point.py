"""The newest hit point that a robot has, by the time that is left until the ball is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import two_digits
from core.chain.control.player import PlayerState
from core.history.lead_time import true_crossings
from core.physics.flight import Air, fly
from core.recordings import BallTruth

Array = NDArray[np.float64]

LEADS_MS: Final = (400, 300, 200, 150, 100, 50, 25)
"""Times before the impact; a racket that moves 0.5 m needs about 200 ms."""
BEHIND_S: Final = 0.3
"""A ball that was struck is flown on for so long: from the nearest place to the farthest at 3 m/s."""
STEP_US: Final = 1000
HIT_POINT: Final = """The newest hit point that is known so long before the ball is at the last one: median distance
from where it comes through there, mm (balls with one)."""
LEAD_TITLES: Final = tuple(f"{lead} ms" for lead in LEADS_MS)


def hit_point(state: PlayerState) -> Array | None:
    """(3,) the new hit point after a step: as decided where the hit is chosen, or at the plane; None without one."""
    if state.choice is not None:
        return state.decision.state[:3] if state.is_new and state.decision is not None else None
    found = state.chain.prediction
    return found.hit_plane.p_world_m if state.chain.is_new and found is not None and found.hit_plane else None


def newest_hit_errors_mm(
    told: Sequence[tuple[int, Array]], truth: BallTruth, air: Air, leads_ms: Sequence[int] = LEADS_MS
) -> list[float | None]:
    """Distance between the newest hit point and where the ball comes through at that x, mm, for each time before the
    ball is at the last hit point.

    None where none was known by then, or the ball does not come so far, and all None if it never is at the last one. A
    ball that was struck would have flown on: the point before may have been farther behind.

    Args:
        told: when each hit point was known, us, and the point (3,); ascending.
        truth: the ball of this flight.
        air: the true one.
        leads_ms: times before the ball is at the last hit point.
    """
    unstruck = _as_if_not_struck(truth, air)
    xs_m = [round(float(place[0]), 4) for _, place in told]
    crossings = {x_m: true_crossings(unstruck, x_m) for x_m in xs_m}
    if not told or not len(crossings[xs_m[-1]][0]):
        return [None] * len(leads_ms)
    t_us = int(crossings[xs_m[-1]][0][0])
    found: list[float | None] = []
    for lead_ms in leads_ms:
        known = sum(known_us <= t_us - 1000 * lead_ms for known_us, _ in told)
        places_m = crossings[xs_m[known - 1]][1] if known else ()
        off_m = [float(np.linalg.norm(told[known - 1][1][1:] - place_m[1:])) for place_m in places_m[:1]]
        found.append(1e3 * off_m[0] if off_m else None)
    return found


def _as_if_not_struck(truth: BallTruth, air: Air) -> BallTruth:
    """The ball up to the stroke, and then as it would have flown on; as it is without a stroke."""
    vx, seen = truth.v_world_mps[:, 0], truth.visible
    struck = np.flatnonzero(seen[:-1] & seen[1:] & (vx[:-1] < 0) & (vx[1:] >= 0))
    if not len(struck):
        return truth
    last = int(struck[0])
    t_us = truth.t_us[last] + STEP_US * np.arange(1, 1 + round(1e6 * BEHIND_S) // STEP_US)
    states, state = [], np.concatenate([truth.p_world_m[last], truth.v_world_mps[last], truth.spin_radps[last]])
    for _ in t_us:
        fly(state, 1e-6 * STEP_US, air, state)
        states.append(state.copy())
    p, v, spin = np.split(np.array(states), 3, axis=1)
    longer = BallTruth(t_us, p, v, spin, np.ones(len(t_us), np.bool_))
    names = ("t_us", "p_world_m", "v_world_mps", "spin_radps", "visible")
    return BallTruth(*(np.concatenate([getattr(truth, name)[: last + 1], getattr(longer, name)]) for name in names))


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
