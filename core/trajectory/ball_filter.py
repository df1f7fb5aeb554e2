"""Extended Kalman filter of a ball with bounces on the table, and how it decides that the ball bounced.

Two hypotheses are kept, off the table and past it, until the points decide. When the ball comes to the table is as
uncertain as its height, and for that time an observation fits neither flight well. So nothing is taken from the points
in between, and the first ones after it decide: two flights part by 5 mm a millisecond. That a ball passes the table's
edge, or a table that is lower than it should be, is found the same way.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.table import BALL_RADIUS_M, TABLE_LENGTH_M, TABLE_WIDTH_M
from core.trajectory.ball_kernel import HIGHER, LIFT, STATE, down_in, glide
from core.trajectory.filter_config import FilterConfig
from core.trajectory.filter_kernel import ProcessNoise, bounce_estimate, move
from core.trajectory.observation import Observation, PointObservation

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
        """Begin with the last estimate before the bounce.

        Args:
            t_us: time of the estimate.
            x: (14,) estimate.
            cov: (14, 14) its covariance.
            contact: when and where it touches the table.
            process_noise: of air and bounce.
            guard_s: time around the bounce, beside that of its uncertainty, in which points are not compared.
        """
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


FIRST_VELOCITY_MPS: Final = (-4.0, 0.0, 0.0)
# Wide enough for play as well: strokes of persons have 5 / 9 / 20 m/s (5 / 50 / 95 % of a public match).
FIRST_SIGMA_MPS: Final = 10.0
SETTLED: Final = 4
"""Points from which the velocity is known well enough to predict a bounce."""
TYPICAL: Final = 8
"""Points from which a point's likelihood reflects the flight rather than the prior."""
SCALES: Final = (0.01, 100.0)
"""Bounds of the estimated scale of the noise variance."""


class BallFilter:
    """One flight; what the model leaves out is one of the two amounts of the configuration."""

    def __init__(
        self, config: FilterConfig, t_us: int, p: Array, noise_m2: Array, *, needs_tick: bool, odds: float
    ) -> None:
        """Begin with a point and its covariance; `odds`: of this kind of flight before anything is seen.

        Args:
            config: constants with their spreads.
            t_us: time of the first point.
            p: (3,) its position, m, world.
            noise_m2: (3, 3) its covariance.
            needs_tick: whether this flight has the larger process noise.
            odds: of this kind of flight before anything is seen.
        """
        c = self._config = config
        air, bounce = (c.restless_air, c.restless_bounce_mps) if needs_tick else (c.air_noise, c.bounce_noise_mps)
        self.process_noise = ProcessNoise(LIFT * c.magnus, air, bounce, c.ahead_m, c.ahead_s)
        self.state = np.array([*p, *FIRST_VELOCITY_MPS, 0.0, 0.0, 0.0, c.drag, c.restitution, c.friction, 0.0, 0.0])
        # The place has the first point's own covariance, and may be ahead of the ball like every point.
        sigmas = [0.0] * 3 + [FIRST_SIGMA_MPS] * 3 + [c.spin_sigma_radps] * 3
        constants = [c.drag_sigma, c.restitution_sigma, c.friction_sigma, c.table_sigma_m, c.ahead_m]
        self.covariance = np.diag(np.square([*sigmas, *constants]))
        self.covariance[:3, :3] = noise_m2 + c.ahead_m**2 * np.eye(3)
        self.t_us = self.first_us = t_us
        self.bounces_us: tuple[int, ...] = ()
        self.strays = 0
        """Consecutive outliers."""
        self.prior = math.log(odds)
        """Logarithm of the odds before anything is seen."""
        self.log_odds = self.prior
        """Log odds of this kind of flight given its points, up to a constant."""
        self.spoke = False
        """Whether the newest observation was compared with the prediction; those near a bounce are not."""
        self.accepted = False
        """Whether the newest observation moved the estimate."""
        self.points = 1
        """Number of points used."""
        self._question: BounceQuestion | None = None
        self._tally = np.zeros((2, 3))

    @property
    def is_asking(self) -> bool:
        """Whether it is undecided if the ball has bounced."""
        return self._question is not None

    @property
    def noise_scales(self) -> Array:
        """(3,) variances of the observations over what was said of them, by the innovations of this flight."""
        weight = self._config.adapt_points
        if weight == 0:
            return np.ones(3)
        return np.clip((weight + self._tally[0]) / (weight + self._tally[1]), *SCALES)

    def take(self, t_us: int, seen: Observation) -> None:
        """Predict to this time, and update with what was seen. Pixels neither count as points nor begin a flight."""
        if self._question is None:
            self._question = self._ask(t_us)
        seconds, self.t_us = (t_us - self.t_us) * 1e-6, t_us
        if self._question is None:
            move(self.state, self.covariance, seconds, self.process_noise)
            noise_scales, lift = self.noise_scales, self.process_noise.lift
            distance, likelihood = seen.update(self.state, self.covariance, noise_scales, self._tally, lift)
            self.spoke = True
            self.accepted = distance <= seen.gate
            if isinstance(seen, PointObservation):
                self.points += 1
                self.strays = 0 if self.accepted else self.strays + 1
            if self.points > TYPICAL:
                self.log_odds += likelihood
            return
        bounced = self._question.add(t_us, seen, self.noise_scales)
        self.accepted = False
        self.spoke = self._question.likelihood is not None
        if self._config.perhaps_real:
            self.log_odds += self._question.likelihood or 0.0
        self.state, self.covariance = self._question.likelier
        if bounced is not None:
            if bounced:
                self.bounces_us = (*self.bounces_us, self._question.bounced_us())
            self._question = None

    def _ask(self, t_us: int) -> BounceQuestion | None:
        """Start a bounce question if a bounce may happen before the next point."""
        if self.points < SETTLED:
            return None
        contact = coming_contact(self.state, self.covariance, self.process_noise.lift)
        if contact is None or contact.in_s - SIGMAS * contact.sigma_s > (t_us - self.t_us) * 1e-6:
            return None
        guard_s = 1e-3 * self._config.bounce_guard_ms
        return BounceQuestion(self.t_us, self.state, self.covariance, contact, self.process_noise, guard_s)
