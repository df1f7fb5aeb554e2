"""A recursive filter of the ball: drag, Magnus, spin from the flight, a bounce that knows spin, honest covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.trajectory.ball_filter import BallFilter
from core.trajectory.ball_kernel import STATE, TOUCHES, places
from core.trajectory.filter_config import FilterConfig, with_physics
from core.trajectory.filter_kernel import ROWS, foresee
from core.trajectory.prediction import HitPlane, Prediction, Stage, TablePoint

Array = NDArray[np.float64]

STRAYS: Final = 5
"""So many points in a row that do not fit begin a new flight."""
SLOWEST_MPS: Final = 1.0
NOTHING: Final = np.full((STATE, STATE), np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """The estimate and its neighbours, one sigma away along each independent direction, and what they touch."""

    t_s: float
    states: Array
    """(27, 14)."""
    lift: float

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at ascending times (K,), not before the newest observation."""
        ps = np.empty((len(self.states), len(t_s), 3))
        places(self.states, self.t_s, np.ascontiguousarray(t_s), self.lift, ps)
        return ps

    def nominal(self) -> Paths:
        """The estimate alone, without its neighbours."""
        return Paths(self.t_s, self.states[:1], self.lift)


class FilterPredictor:
    """Fed point by point like `PaperPredictor`; every point moves the estimate.

    Filters for several kinds of flights run side by side: one that the model describes, one of which it leaves a good
    deal out, perhaps one with air and spin. The one that explains the points best is believed.
    """

    def __init__(self, config: FilterConfig | None = None, *, hit_x_m: float = -1.42) -> None:
        self.config = config or FilterConfig()
        self._hit_x_m = hit_x_m
        self._noise_m2 = self.config.sigma_point_m**2 * np.eye(3)
        self._floor_m2 = self.config.noise_m**2 * np.eye(3)
        self.reset()

    def reset(self) -> None:
        """Forget the flight seen so far."""
        self.latest: Prediction | None = None
        self._filters: tuple[BallFilter, ...] = ()
        self._said_us = 0

    @property
    def believed(self) -> BallFilter | None:
        """The filter that explains the flight best; None before there is a point."""
        return max(self._filters, key=_log_odds, default=None)

    @property
    def state(self) -> Array:
        """(14,) the estimate at the newest point, see `ball_kernel`; nan before there is one."""
        return self.believed.state if self.believed else NOTHING[0]

    @property
    def covariance(self) -> Array:
        """(14, 14) of the estimate."""
        return self.believed.covariance if self.believed else NOTHING

    @property
    def noise_scales(self) -> Array:
        """(3,) variances of the observations over what was said of them, by the innovations of this flight."""
        return self.believed.noise_scales if self.believed else np.ones(3)

    @property
    def bounces_us(self) -> tuple[int, ...]:
        """When the ball bounced in this flight."""
        return self.believed.bounces_us if self.believed else ()

    @property
    def stage(self) -> Stage:
        """Before or after the first bounce that was seen."""
        return "post" if self.bounces_us else "pre"

    def add(self, t_us: int, p_world_m: ArrayLike, covariance_m2: Array | None = None) -> Prediction | None:
        """A new prediction if one is due, else None. Points come in order of time; each may bring its covariance.

        Raises:
            ConfigError: if a point is not later than the one before, or not three finite numbers.
        """
        p = np.array(p_world_m, np.float64)
        if p.shape != (3,) or not math.isfinite(p[0] + p[1] + p[2]):
            raise ConfigError("not a position", expected="3 finite numbers", got=p, where="FilterPredictor.add")
        noise = self._noise_m2 if covariance_m2 is None else covariance_m2 + self._floor_m2
        if not self._filters:
            self._begin(t_us, p, noise)
            return None
        if t_us <= self._filters[0].t_us:
            expected = f"after {self._filters[0].t_us} us"
            raise ConfigError("points are not in order", expected=expected, got=t_us, where="FilterPredictor.add")
        for one in self._filters:
            one.take(t_us, p, noise)
        if all(one.strays >= STRAYS for one in self._filters):
            self._begin(t_us, p, noise)
        due = t_us - self._said_us >= 1e3 * self.config.every_ms
        return self.predict() if due and not any(one.is_asking for one in self._filters) else None

    def predict(self) -> Prediction | None:
        """The flight as it is expected now; None before enough was seen."""
        ball = self.believed
        if ball is None or ball.t_us - ball.first_us < 1e3 * self.config.least_seen_ms:
            return None
        self._said_us = ball.t_us
        rows, spread = np.empty((ROWS, STATE)), np.empty((TOUCHES, TOUCHES))
        now_s, lift = ball.t_us * 1e-6, ball.unrest.lift
        found = foresee(ball.state, ball.covariance, now_s, self._hit_x_m, lift, rows, spread)
        _add_bias(spread, float(ball.state[5]), float(found[16]), self.config.bias_m)
        self.latest = _describe(found, spread, ball.t_us, self.stage, Paths(now_s, rows, lift))
        return self.latest

    def _begin(self, t_us: int, p: Array, noise: Array) -> None:
        c = self.config
        models = (c, with_physics(c, "real")) if c.perhaps_real else (c,)
        odds = {False: 1.0, True: c.restless_odds} if c.restless_odds > 0 else {False: 1.0}
        self._filters = tuple(
            BallFilter(model, t_us, p, noise, restless=restless, odds=odds[restless])
            for model in models
            for restless in odds
        )
        self._said_us = t_us


def _log_odds(one: BallFilter) -> float:
    return one.log_odds


def _add_bias(spread: Array, falling_mps: float, hit_mps: float, bias_m: float) -> None:
    """Add to the covariance (22, 22) of what is touched that all points may be off: so are place and time.

    By the velocities down onto the table, and through the hitting plane.
    """
    for first, velocity_mps in ((0, falling_mps), (4, falling_mps), (8, falling_mps), (12, hit_mps)):
        spread[first, first] += (bias_m / max(abs(velocity_mps), SLOWEST_MPS)) ** 2
        for axis in range(first + 1, first + 4):
            spread[axis, axis] += bias_m**2


def _describe(found: Array, spread: Array, newest_us: int, stage: Stage, paths: Paths) -> Prediction:
    """What `foresee` found, by names."""
    sigmas = np.sqrt(spread.diagonal())
    points = [
        TablePoint(float(found[k]), found[k + 1 : k + 4], sigmas[k + 1 : k + 4]) if found[k] == found[k] else None
        for k in (0, 4, 8)
    ]
    hit_plane = None
    if found[12] == found[12]:
        hit_plane = HitPlane(
            t_s=float(found[12]),
            sigma_t_s=float(sigmas[12]),
            p_world_m=found[13:16],
            sigma_m=sigmas[13:16],
            v_world_mps=found[16:19],
            sigma_mps=sigmas[16:19],
            covariance=spread[13:19, 13:19],
            stage=stage,
            spin_radps=found[19:22],
        )
    bounces = tuple(point for point in points[:2] if point is not None)
    return Prediction(newest_us, stage, bounces, points[2], hit_plane, paths)
