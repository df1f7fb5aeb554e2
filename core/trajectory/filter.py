"""A recursive filter of the ball: drag, Magnus, spin from the flight, a bounce that knows spin, honest covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import check_settings, setting
from core.errors import ConfigError
from core.trajectory.ball_kernel import LIFT, STATE, TOUCHES, observe, places, predict_step, touches
from core.trajectory.config import PhysicsName
from core.trajectory.prediction import Prediction, Stage, describe_flights

Array = NDArray[np.float64]

STRAYS: Final = 5
"""So many points in a row that do not fit begin a new flight."""
GATE: Final = 40.0
"""Squared normalised distance in three dimensions; a right point is beyond it once in 10^8."""
FIRST_VELOCITY_MPS: Final = (-4.0, 0.0, 0.0)
FIRST_SIGMA_MPS: Final = 10.0
FASTEST_PERIOD_US: Final = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterConfig:
    """The defaults are for the physics called `real`."""

    hit_x_m: float = setting(-1.42, -3.0, 1.37)
    """The hitting plane, as the paper's predictor has it."""
    sigma_point_m: float = setting(0.003, 1e-5, 0.1, step=0.0005)
    """Standard deviation of an observed position along each axis."""
    drag: float = setting(0.51, 0.0, 1.0)
    """Drag coefficient: between a sphere's .47 and the .55 fitted to 70 recorded flights."""
    drag_sigma: float = setting(0.04, 1e-6, 0.5)
    """What is not known of it."""
    magnus: float = setting(0.10, 0.0, 0.5)
    """Magnus coefficient; only its product with the spin moves the ball in the air."""
    spin_sigma_radps: float = setting(150.0, 1.0, 1000.0)
    """Standard deviation of the spin about each axis before anything is seen."""
    restitution: float = setting(0.92, 0.5, 1.0)
    """Of the table: between the simulated .90 and the .945 fitted to recorded flights."""
    restitution_sigma: float = setting(0.025, 1e-6, 0.3)
    """What is not known of it."""
    friction: float = setting(0.24, 0.0, 1.0)
    """Of the table: between the literature's .25 and the .227 fitted to recorded flights."""
    friction_sigma: float = setting(0.03, 1e-6, 0.3)
    """What is not known of it."""
    air_noise: float = setting(0.02, 0.0, 5.0)
    """White acceleration, m/s^2 per root hertz: what the model of the air leaves out."""
    bounce_noise_mps: float = setting(0.02, 0.0, 1.0)
    """Scatter of each velocity component from bounce to bounce."""
    least_seen_ms: float = setting(20.0, 1.0, 200.0)
    """Nothing is said before so much of a flight was seen."""
    every_ms: float = setting(4.0, 0.0, 50.0)
    """A prediction at most so often; the estimate takes every point."""

    def __post_init__(self) -> None:
        check_settings(self)


def filter_for(physics: PhysicsName, *, hit_x_m: float = -1.42, sigma_point_m: float = 0.003) -> FilterConfig:
    """The filter for the physics called `paper` (no air, no serve with spin) or `real`."""
    if physics == "real":
        return FilterConfig(hit_x_m=hit_x_m, sigma_point_m=sigma_point_m)
    return FilterConfig(
        hit_x_m=hit_x_m,
        sigma_point_m=sigma_point_m,
        drag=0.0,
        drag_sigma=1e-6,
        magnus=0.0,
        spin_sigma_radps=10.0,
        restitution=0.90,
        restitution_sigma=0.01,
        friction=0.15,
        friction_sigma=0.02,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """The estimate and its neighbours, one sigma away along each independent direction, and what they touch."""

    t_s: float
    states: Array
    """(1 + 2 * 12, 12)."""
    found: Array
    """(25, 19) as `touches` writes it."""
    lift: float

    def bounces(self) -> tuple[tuple[Array, Array], ...]:
        """Times (N,) and positions (N, 3)."""
        return tuple((self.found[:, k], self.found[:, k + 1 : k + 4]) for k in (0, 4))

    def landing(self, after_s: float) -> tuple[Array, Array]:
        """When (N,) and where (N, 3) the balls next come down to the table's plane."""
        return self.found[:, 8], self.found[:, 9:12]

    def hits(self, x_m: float) -> tuple[Array, Array]:
        """When (N,) the balls cross the hitting plane, and their states (N, 6) there."""
        return self.found[:, 12], self.found[:, 13:19]

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at ascending times (K,), not before the newest observation."""
        ps = np.empty((len(self.states), len(t_s), 3))
        places(self.states, self.t_s, np.ascontiguousarray(t_s), self.lift, ps)
        return ps

    def nominal(self) -> Paths:
        """The estimate alone."""
        return Paths(self.t_s, self.states[:1], self.found[:1], self.lift)


class FilterPredictor:
    """Fed point by point like `PaperPredictor`; every point moves the estimate."""

    def __init__(self, config: FilterConfig | None = None) -> None:
        self.config = config or FilterConfig()
        self._lift = LIFT * self.config.magnus
        self._noise = np.array([self.config.air_noise, self.config.bounce_noise_mps])
        self.reset()

    def reset(self) -> None:
        """Forget the flight."""
        self.bounces_us: tuple[int, ...] = ()
        self.latest: Prediction | None = None
        self.state = np.full(STATE, np.nan)
        self.covariance = np.full((STATE, STATE), np.nan)
        self._t_us: int | None = None
        self._first_us = self._said_us = 0
        self._strays = 0

    @property
    def stage(self) -> Stage:
        """Before or after the first bounce of the estimate."""
        return "post" if self.bounces_us else "pre"

    def add(self, t_us: int, p_world_m: ArrayLike) -> Prediction | None:
        """A new prediction if one is due, else None. Points come in order of time.

        Raises:
            ConfigError: if a point is not later than the one before, or not three finite numbers.
        """
        p = np.array(p_world_m, np.float64)
        if p.shape != (3,) or not np.isfinite(p).all():
            raise ConfigError("not a position", expected="3 finite numbers", got=p, where="FilterPredictor.add")
        if self._t_us is None:
            self._begin(t_us, p)
            return None
        if t_us <= self._t_us:
            expected = f"after {self._t_us} us"
            raise ConfigError("points are not in order", expected=expected, got=t_us, where="FilterPredictor.add")
        since = predict_step(self.state, self.covariance, (t_us - self._t_us) * 1e-6, self._lift, self._noise)
        self._t_us = t_us
        if since >= 0:
            self.bounces_us = (*self.bounces_us, t_us - round(1e6 * since))
        far = observe(self.state, self.covariance, p, self.config.sigma_point_m, GATE) > GATE
        self._strays = self._strays + 1 if far else 0
        if self._strays == STRAYS:
            self._begin(t_us, p)
        seen_us = t_us - self._first_us
        due = seen_us >= 1e3 * self.config.least_seen_ms and t_us - self._said_us >= 1e3 * self.config.every_ms
        return self.predict() if due else None

    def predict(self) -> Prediction | None:
        """The flight as it is expected now; None before enough was seen."""
        if self._t_us is None or self._t_us - self._first_us < 1e3 * self.config.least_seen_ms:
            return None
        self._said_us = self._t_us
        now_s = self._t_us * 1e-6
        states = _one_sigma_rows(self.state, self.covariance)
        found = np.empty((len(states), TOUCHES))
        touches(states, now_s, self.config.hit_x_m, self._lift, found)
        paths = Paths(now_s, states, found, self._lift)
        self.latest = describe_flights(paths, self._t_us, self.stage, self.config.hit_x_m)
        return self.latest

    def _begin(self, t_us: int, p: Array) -> None:
        c = self.config
        self.state = np.array([*p, *FIRST_VELOCITY_MPS, 0.0, 0.0, 0.0, c.drag, c.restitution, c.friction])
        sigmas = [c.sigma_point_m] * 3 + [FIRST_SIGMA_MPS] * 3 + [c.spin_sigma_radps] * 3
        self.covariance = np.diag(np.square([*sigmas, c.drag_sigma, c.restitution_sigma, c.friction_sigma]))
        self._t_us = self._first_us = self._said_us = t_us
        self.bounces_us = ()
        self._strays = 0


def _one_sigma_rows(state: Array, covariance: Array) -> Array:
    """(25, 12) the state, and a step up and down along each column of the covariance's root."""
    sigmas = np.sqrt(np.diag(covariance).clip(1e-24))
    correlation = covariance / np.outer(sigmas, sigmas) + 1e-9 * np.eye(STATE)
    values, vectors = np.linalg.eigh(correlation)
    root = sigmas[:, None] * vectors * np.sqrt(values.clip(0.0))
    rows = np.tile(state, (1 + 2 * STATE, 1))
    rows[1::2] += root.T
    rows[2::2] -= root.T
    return rows
