"""Detection of the stroke in a ball's track: where it turns back."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.outcomes.ball_log import BallPoints
from core.outcomes.config import OutcomeClassifierConfig
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]
RISE_M: Final = 0.03
"""Distance along x after which a ball counts as coming back (choice: many times the noise, 10 ms of a slow return)."""
RISING_POINTS: Final = 5
PAST_POINTS: Final = 3
NEAR_PLANE_M: Final = 0.05
SHORT_M: Final = 0.08
"""Distance by which a ball falls short of its undisturbed flight after a turn (choice)."""
LOOK_BACK_S: Final = 0.25
"""The turn is searched this long before the point that shows it."""
BEFORE_S: Final = 0.040
"""Duration of the flight before the stroke from which the incoming state is estimated (choice)."""


def turned(points: BallPoints, config: OutcomeClassifierConfig) -> float | None:
    """When (seconds of `points`) the ball was nearest to the robot, if its newest points come back; None if not.

    To be asked at every point: the racket's own events give a stray now and then, so several in a row have to agree.
    """
    t, x = points.t_s, points.ps_m[:, 0]
    last = slice(len(t) - RISING_POINTS, len(t))
    if len(t) < RISING_POINTS or not (np.diff(x[last]) > 0).all():
        return None
    rate_mps = (x[-1] - x[-RISING_POINTS]) / (t[-1] - t[-RISING_POINTS])
    recent = np.flatnonzero(t >= t[-1] - LOOK_BACK_S)
    nearest = int(recent[np.argmin(x[recent])])
    came_back = x[nearest] < config.reach_x_m and x[-1] > x[nearest] + RISE_M
    return float(t[nearest]) if came_back and rate_mps >= config.slowest_return_mps else None


def went_past(points: BallPoints, config: OutcomeClassifierConfig, hit_x_m: float) -> bool:
    """Whether the newest points are well behind the hitting plane."""
    x = points.ps_m[-PAST_POINTS:, 0]
    return len(x) == PAST_POINTS and bool((x < hit_x_m - config.behind_m).all())


def stopped_at(points: BallPoints, config: OutcomeClassifierConfig, hit_x_m: float) -> Array | None:
    """(3,) where a ball met the racket that then neither came back nor went on: it fell between racket and table.

    Its newest points are below the table, in the racket's reach, and well short of where its flight would have led.
    """
    t, x, z = points.t_s, points.ps_m[:, 0], points.ps_m[:, 2]
    newest = slice(len(x) - RISING_POINTS, len(x))
    if len(x) < 2 * RISING_POINTS or (z[newest] > -BALL_RADIUS_M).any():
        return None
    near = np.flatnonzero(x < hit_x_m + NEAR_PLANE_M)
    if not len(near):
        return None
    met_s = float(t[near[0]])
    before = points.part((t <= met_s) & (t > met_s - BEFORE_S))
    if len(before) < RISING_POINTS:
        return None
    slope, offset = _robust_line(before.t_s - met_s, before.ps_m[:, 0])
    short_m = x[newest] - (offset + slope * (t[newest] - met_s))
    reached = np.abs(x[newest] - hit_x_m) < config.behind_m
    return before.ps_m[-1] if slope < 0 and (short_m > SHORT_M).all() and reached.all() else None


def contact_time(points: BallPoints, turn_s: float, x_m: float, vx_mps: float, at_s: float, guard_s: float) -> float:
    """When the ball met the racket: where the flight before it and the one after it are at the same x.

    The flight after it is at `x_m` with `vx_mps` at the time `at_s`. Without enough points before the turn, the turn.
    """
    before = points.part((points.t_s < turn_s - guard_s) & (points.t_s > turn_s - guard_s - BEFORE_S))
    if len(before) < 3:
        return turn_s
    slope, offset = _robust_line(before.t_s - turn_s, before.ps_m[:, 0])
    if vx_mps - slope < 0.5:
        return turn_s
    met_s = turn_s + (offset - (x_m + vx_mps * (turn_s - at_s))) / (vx_mps - slope)
    # A line through a few points is extrapolated no farther than the gap without points.
    seen = points.t_s[points.t_s > turn_s + 1e-9]
    return float(np.clip(met_s, before.t_s[-1], seen[min(3, len(seen) - 1)] if len(seen) else turn_s))


def _robust_line(t_s: Array, x_m: Array) -> tuple[float, float]:
    """Slope and value at time zero: the medians of pairs of points (Theil and Sen)."""
    i, j = np.triu_indices(len(t_s), 1)
    slope = float(np.median((x_m[j] - x_m[i]) / (t_s[j] - t_s[i])))
    return slope, float(np.median(x_m - slope * t_s))
