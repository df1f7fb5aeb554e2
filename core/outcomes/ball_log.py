"""The points of one ball, in order of time, as columns.

Beside them what they show of it: the time and speed of a serve when it was first seen, and the stroke, where the track
turns back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.outcomes.config import OutcomeClassifierConfig
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]
MAX_POINTS = 4000
"""Most points of one ball, so that a ball at rest does not fill the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class BallPoints:
    """(K,) points; times in seconds since `start_us`, so that microseconds keep their digits."""

    start_us: int
    t_s: Array
    ps_m: Array
    """(K, 3)."""
    covariances_m2: Array
    """(K, 3, 3)."""

    def __len__(self) -> int:
        return len(self.t_s)

    def part(self, which: slice | NDArray[np.bool_] | NDArray[np.intp]) -> BallPoints:
        """Selected points."""
        return BallPoints(self.start_us, self.t_s[which], self.ps_m[which], self.covariances_m2[which])


class BallLog:
    """Filled point by point."""

    def __init__(self) -> None:
        self._t_us = np.empty(MAX_POINTS, np.int64)
        self._ps = np.empty((MAX_POINTS, 3))
        self._covariances = np.empty((MAX_POINTS, 3, 3))
        self._count = 0

    def clear(self) -> None:
        """Forget the ball."""
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def last_us(self) -> int | None:
        """Time of the newest point; None without one."""
        return int(self._t_us[self._count - 1]) if self._count else None

    def add(self, t_us: int, p_m: Array, covariance_m2: Array) -> bool:
        """Add a point; False for one that is not later than the last, not finite, or too many."""
        n = self._count
        if n == MAX_POINTS or (n and t_us <= self._t_us[n - 1]) or not np.isfinite(p_m).all():
            return False
        self._t_us[n], self._ps[n], self._covariances[n] = t_us, p_m, covariance_m2
        self._count = n + 1
        return True

    def keep_last(self, count: int) -> None:
        """Forget all but the newest points."""
        for column in (self._t_us, self._ps, self._covariances):
            column[:count] = column[self._count - count : self._count].copy()
        self._count = count

    def points(self) -> BallPoints:
        """All points so far; valid until the next one is added."""
        n = self._count
        start_us = int(self._t_us[0]) if n else 0
        t_s = np.asarray((self._t_us[:n] - start_us) * 1e-6, np.float64)
        return BallPoints(start_us, t_s, self._ps[:n], self._covariances[:n])


RISE_M: Final = 0.03
"""Distance along x after which a ball counts as coming back (choice: many times the noise, 10 ms of a slow return)."""
RISING_POINTS: Final = 5
PAST_POINTS: Final = 3
"""Newest points that have to agree that a ball comes back, or is past the racket: a stray must not decide. Chosen by
hand; not measured."""
NEAR_PLANE_M: Final = 0.05
"""A ball that is this near to where it is to be hit may have met the racket. Chosen by hand; not measured."""
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
    """Whether the newest points are well behind where the ball was to be hit."""
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

    Args:
        points: seen points of the ball.
        turn_s: when the ball turned, as seen.
        x_m: x of the ball after it, at `at_s`.
        vx_mps: its velocity along x then.
        at_s: the time of these.
        guard_s: points nearer to the turn than this are left out: a window may hold both flights.
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


SPAN_S: Final = 0.060
"""Duration of the first points used (choice): before the bounce, and long enough for an error of some cm/s."""
FEWEST: Final = 5
"""Points from which a serve is told. Chosen by hand; not measured."""
SLOWEST_MPS: Final = 1.0
"""Slowest speed of a serve towards the robot (choice)."""


@dataclass(frozen=True, slots=True, eq=False)
class ServeSeen:
    """An observed serve."""

    t_us: int
    """Time of its first point: the ball was served then or just before."""
    p_world_m: Array
    """(3,) there."""
    v_world_mps: Array
    """(3,) there."""
    sigma_mps: float
    """Standard deviation of the speed, from the scatter of the points about the fitted flight."""

    @property
    def speed_mps(self) -> float:
        """Speed when it was first seen, m/s."""
        return float(np.linalg.norm(self.v_world_mps))


def see_serve(points: BallPoints) -> ServeSeen | None:
    """Serve from its first points; None without enough of them, or if the ball does not come towards the robot."""
    first = points.part(points.t_s <= SPAN_S)
    if len(first) < FEWEST or first.t_s[-1] < SPAN_S / 3:
        return None
    fit = _free_fall(first.t_s, first.ps_m)
    spread = fit.residuals_m
    right = np.linalg.norm(spread, axis=1) <= 3 * max(1.5 * float(np.median(np.linalg.norm(spread, axis=1))), 5e-4)
    if FEWEST <= right.sum() < len(right):
        fit = _free_fall(first.t_s[right], first.ps_m[right])
    if fit.v_mps[0] > -SLOWEST_MPS:
        return None
    scatter = float(np.sqrt((fit.residuals_m**2).mean())) + 2e-4
    t = first.t_s[right] if right.sum() >= FEWEST else first.t_s
    sigma = scatter / max(float(np.sqrt(((t - t.mean()) ** 2).sum())), 1e-6)
    return ServeSeen(points.start_us, fit.p_m, fit.v_mps, sigma)


@dataclass(frozen=True, slots=True, eq=False)
class _FreeFall:
    p_m: Array
    v_mps: Array
    residuals_m: Array


def _free_fall(t_s: Array, ps_m: Array) -> _FreeFall:
    """Fit of free fall to points (K, 3): state at time zero."""
    lifted = ps_m.copy()
    lifted[:, 2] += 0.5 * GRAVITY_MPS2 * t_s**2
    design = np.column_stack([np.ones(len(t_s)), t_s])
    found = np.linalg.lstsq(design, lifted, rcond=None)[0]
    return _FreeFall(found[0], found[1], lifted - design @ found)
