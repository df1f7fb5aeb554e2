"""A recursive filter of the ball: drag, Magnus, spin from the flight, a bounce that knows spin, honest covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.trajectory.ball_kernel import LIFT, STATE, TOUCHES, places
from core.trajectory.bounce_question import SIGMAS, BounceQuestion, coming_contact
from core.trajectory.filter_config import FilterConfig
from core.trajectory.filter_kernel import ROWS, Unrest, foresee, move, observe
from core.trajectory.prediction import HitPlane, Prediction, Stage, TablePoint

Array = NDArray[np.float64]

STRAYS: Final = 5
"""So many points in a row that do not fit begin a new flight."""
GATE: Final = 40.0
"""Squared normalised distance in three dimensions; a right point is beyond it once in 10^8."""
FIRST_VELOCITY_MPS: Final = (-4.0, 0.0, 0.0)
FIRST_SIGMA_MPS: Final = 10.0
SETTLED: Final = 4
"""From so many points on, the velocity is known well enough to expect a bounce."""
SCALES: Final = (0.01, 100.0)
"""Bounds of what may be learnt of the variance of the noise."""


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
        """The estimate alone."""
        return Paths(self.t_s, self.states[:1], self.lift)


class FilterPredictor:
    """Fed point by point like `PaperPredictor`; every point moves the estimate."""

    def __init__(self, config: FilterConfig | None = None, *, hit_x_m: float = -1.42) -> None:
        self.config = config or FilterConfig()
        self._hit_x_m = hit_x_m
        c = self.config
        self._unrest = Unrest(LIFT * c.magnus, c.air_noise, c.bounce_noise_mps, c.ahead_m, c.ahead_s)
        self._noise_m2 = c.sigma_point_m**2 * np.eye(3)
        self._floor_m2 = c.noise_m**2 * np.eye(3)
        self.reset()

    def reset(self) -> None:
        """Forget the flight."""
        self.bounces_us: tuple[int, ...] = ()
        self.latest: Prediction | None = None
        self.state = np.full(STATE, np.nan)
        self.covariance = np.full((STATE, STATE), np.nan)
        self._t_us: int | None = None
        self._first_us = self._said_us = 0
        self._points = self._strays = 0
        self._question: BounceQuestion | None = None
        self._tally = np.zeros((2, 3))

    @property
    def stage(self) -> Stage:
        """Before or after the first bounce that was seen."""
        return "post" if self.bounces_us else "pre"

    @property
    def noise_scales(self) -> Array:
        """(3,) variances of the observations over what was said of them, by the innovations of this flight."""
        weight = self.config.adapt_points
        if weight == 0:
            return np.ones(3)
        return np.clip((weight + self._tally[0]) / (weight + self._tally[1]), *SCALES)

    def add(self, t_us: int, p_world_m: ArrayLike, covariance_m2: Array | None = None) -> Prediction | None:
        """A new prediction if one is due, else None. Points come in order of time; each may bring its covariance.

        Raises:
            ConfigError: if a point is not later than the one before, or not three finite numbers.
        """
        p = np.array(p_world_m, np.float64)
        if p.shape != (3,) or not math.isfinite(p[0] + p[1] + p[2]):
            raise ConfigError("not a position", expected="3 finite numbers", got=p, where="FilterPredictor.add")
        noise = self._noise_m2 if covariance_m2 is None else covariance_m2 + self._floor_m2
        if self._t_us is None:
            self._begin(t_us, p, noise)
            return None
        if t_us <= self._t_us:
            expected = f"after {self._t_us} us"
            raise ConfigError("points are not in order", expected=expected, got=t_us, where="FilterPredictor.add")
        self._take(t_us, p, noise)
        if self._strays == STRAYS:
            self._begin(t_us, p, noise)
        seen_us = t_us - self._first_us
        due = seen_us >= 1e3 * self.config.least_seen_ms and t_us - self._said_us >= 1e3 * self.config.every_ms
        return self.predict() if due and self._question is None else None

    def predict(self) -> Prediction | None:
        """The flight as it is expected now; None before enough was seen."""
        if self._t_us is None or self._t_us - self._first_us < 1e3 * self.config.least_seen_ms:
            return None
        self._said_us = self._t_us
        rows, spread = np.empty((ROWS, STATE)), np.empty((TOUCHES, TOUCHES))
        now_s = self._t_us * 1e-6
        found = foresee(self.state, self.covariance, now_s, self._hit_x_m, self._unrest.lift, rows, spread)
        self.latest = _describe(found, spread, self._t_us, self.stage, Paths(now_s, rows, self._unrest.lift))
        return self.latest

    def _take(self, t_us: int, p: Array, noise: Array) -> None:
        """Move the estimate to the time of a point, and take the point."""
        assert self._t_us is not None
        if self._question is None:
            self._question = self._ask(t_us)
        seconds, self._t_us = (t_us - self._t_us) * 1e-6, t_us
        if self._question is None:
            move(self.state, self.covariance, seconds, self._unrest)
            distance, _ = observe(self.state, self.covariance, p, noise, self.noise_scales, GATE, self._tally)
            self._points += 1
            self._strays = self._strays + 1 if distance > GATE else 0
            return
        bounced = self._question.add(t_us, p, noise, self.noise_scales, GATE)
        self.state, self.covariance = self._question.likelier
        if bounced is not None:
            if bounced:
                self.bounces_us = (*self.bounces_us, self._question.bounced_us())
            self._question = None

    def _ask(self, t_us: int) -> BounceQuestion | None:
        """Whether a bounce is near until the next point."""
        assert self._t_us is not None
        if self._points < SETTLED:
            return None
        contact = coming_contact(self.state, self.covariance, self._unrest.lift)
        if contact is None or contact.in_s - SIGMAS * contact.sigma_s > (t_us - self._t_us) * 1e-6:
            return None
        guard_s = 1e-3 * self.config.bounce_guard_ms
        return BounceQuestion(self._t_us, self.state, self.covariance, contact, self._unrest, guard_s)

    def _begin(self, t_us: int, p: Array, noise: Array) -> None:
        c = self.config
        self.state = np.array([*p, *FIRST_VELOCITY_MPS, 0.0, 0.0, 0.0, c.drag, c.restitution, c.friction, 0.0, 0.0])
        sigmas = [0.0] * 3 + [FIRST_SIGMA_MPS] * 3 + [c.spin_sigma_radps] * 3
        constants = [c.drag_sigma, c.restitution_sigma, c.friction_sigma, c.table_sigma_m, c.ahead_m]
        self.covariance = np.diag(np.square([*sigmas, *constants]))
        self.covariance[:3, :3] = noise + c.ahead_m**2 * np.eye(3)
        self._t_us = self._first_us = self._said_us = t_us
        self.bounces_us = ()
        self._points, self._strays, self._question = 1, 0, None


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
