"""Decides whether the ball bounced: two hypotheses, off the table and past it, until the points decide.

When the ball comes to the table is as uncertain as its height, and for that time an observation fits neither flight
well. So nothing is taken from the points in between, and the first ones after it decide: two flights part by 5 mm a
millisecond. That a ball passes the table's edge, or a table that is lower than it should be, is found the same way.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.table import BALL_RADIUS_M, TABLE_LENGTH_M, TABLE_WIDTH_M
from core.trajectory.ball_kernel import HIGHER, STATE, down_in, glide
from core.trajectory.filter_kernel import ProcessNoise, bounce_estimate, move
from core.trajectory.observation import Observation

Array = NDArray[np.float64]

SIGMAS: Final = 3.0
"""The ball is near the table while it may be there within this many standard deviations."""
LONGEST_S: Final = 0.008
"""Longest time for which points are ignored, before and after the predicted bounce."""
SURE: Final = math.log(100.0)
"""Odds from which the likelier hypothesis is accepted."""
MAX_POINTS: Final = 5
"""Most points; then the likelier hypothesis is accepted at any odds."""
UNLIKELY: Final = 1e-3
"""Smallest prior probability of either hypothesis, unless the ball is far from the edge."""


class TableTouch(NamedTuple):
    """The coming touch of the table's plane."""

    in_s: float
    """Time from the estimate on, s."""
    sigma_s: float


def coming_contact(x: Array, cov: Array, lift: float) -> TableTouch | None:
    """When the estimate comes down to the table's plane; None for a ball below it."""
    down = down_in(x, lift)
    if not 0 <= down < 1.0:
        return None
    there = np.empty(STATE)
    glide(x, down, lift, there)
    gap = there[2] - BALL_RADIUS_M - there[HIGHER]
    down = max(0.0, down + gap / max(-there[5], 0.1))
    variance = cov[2, 2] + cov[HIGHER, HIGHER] - 2 * cov[2, HIGHER]
    variance += (2 * cov[2, 5] + cov[5, 5] * down) * down
    return TableTouch(down, min(math.sqrt(max(variance, 0.0)) / max(-there[5], 0.1), LONGEST_S / SIGMAS))


class BounceQuestion:
    """Open from just before the bounce until it is decided."""

    def __init__(
        self, t_us: int, x: Array, cov: Array, contact: TableTouch, process_noise: ProcessNoise, guard_s: float
    ) -> None:
        """`x` and `cov`: the estimate at `t_us`, which is the last one before it."""
        self._process_noise = process_noise
        self._t_us = t_us
        self.past = x, cov
        at_table = x.copy(), cov.copy()
        move(*at_table, contact.in_s, process_noise)
        at_table[0][2] = BALL_RADIUS_M + at_table[0][HIGHER]
        self._odds = _log_odds_of_table(*at_table)
        bounce_estimate(*at_table, process_noise)
        self.off = at_table
        self._bounce_us = self._off_us = t_us + round(1e6 * contact.in_s)
        self._quiet_until_us = self._bounce_us + round(1e6 * (SIGMAS * contact.sigma_s + guard_s))
        self._points = 0
        self.likelihood: float | None = None
        """Logarithm of how likely the newest point was, by both flights together; None if it was left out."""

    @property
    def likelier(self) -> tuple[Array, Array]:
        """Estimate of the likelier hypothesis at the newest time."""
        return self.off if self._odds >= 0 and self._t_us >= self._bounce_us else self.past

    def add(self, t_us: int, seen: Observation, scales: Array) -> bool | None:
        """Whether it bounced, or None while undecided. Both hypotheses use the observation unless it is too close to
        the bounce.
        """
        move(*self.past, (t_us - self._t_us) * 1e-6, self._process_noise)
        if t_us > self._off_us:
            move(*self.off, (t_us - self._off_us) * 1e-6, self._process_noise)
            self._off_us = t_us
        self._t_us = t_us
        self.likelihood = None
        if t_us < self._quiet_until_us:
            return None
        unused = np.zeros((2, 3))
        lift = self._process_noise.lift
        off = seen.update(*self.off, scales, unused, lift).log_likelihood
        past = seen.update(*self.past, scales, unused, lift).log_likelihood
        self.likelihood = _either(off, past, self._odds)
        self._odds += off - past
        self._points += 1
        if abs(self._odds) < SURE and self._points < MAX_POINTS:
            return None
        return self._odds >= 0

    def bounced_us(self) -> int:
        """Time of the bounce, estimated from the points after it."""
        x, back = self.off[0], np.empty(STATE)
        t = 0.0
        for _ in range(4):
            glide(x, -t, self._process_noise.lift, back)
            if back[5] <= 0.1:
                return self._bounce_us
            t += (back[2] - BALL_RADIUS_M - back[HIGHER]) / back[5]
        return self._t_us - round(1e6 * t)


def _either(one: float, other: float, odds: float) -> float:
    """Logarithm of the likelihood of a point that has these under two flights, with log odds between them."""
    odds = min(max(odds, -500.0), 500.0)
    first, second = one - math.log1p(math.exp(-odds)), other - math.log1p(math.exp(odds))
    best = max(first, second)
    return best + math.log(math.exp(first - best) + math.exp(second - best))


def _log_odds_of_table(x: Array, cov: Array) -> float:
    """How likely the table is below an estimate at the table's plane, as log odds."""
    share = 1.0
    for axis, half_m in ((0, TABLE_LENGTH_M / 2), (1, TABLE_WIDTH_M / 2)):
        sigma = math.sqrt(max(cov[axis, axis], 1e-12))
        share *= 0.5 * (math.erf((half_m - x[axis]) / sigma / 1.4142) + math.erf((half_m + x[axis]) / sigma / 1.4142))
    share = min(max(share, UNLIKELY), 1 - UNLIKELY)
    return math.log(share / (1 - share))
