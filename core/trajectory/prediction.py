"""A prediction: bounces, landing, crossing of the hitting plane, and positions, each with its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory.config import PaperPredictorConfig
from core.trajectory.continuation import Arcs, Continuation, continue_flights, fit_arcs, one_sigma_moves

Array = NDArray[np.float64]
Stage = Literal["pre", "post"]
CURVE_STEP_S = 0.005
"""5 cm at 10 m/s, for a curve that is drawn."""
UNKNOWNS = 8
"""Position and velocity of the fit, restitution, tangential factor."""


@dataclass(frozen=True, slots=True, eq=False)
class TablePoint:
    """A predicted touch of the table's plane; the position is the ball's centre."""

    t_s: float
    p_world_m: Array
    sigma_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class HitPlane:
    """p_c, v_c and t_c: the ball where it crosses the hitting plane."""

    t_s: float
    sigma_t_s: float
    p_world_m: Array
    sigma_m: Array
    """(3,); along x it is zero: an error along x is one of the time."""
    v_world_mps: Array
    sigma_mps: Array
    covariance: Array
    """(6, 6) of p_c and v_c."""
    stage: Stage
    spin_radps: Array | None = None
    """(3,) the ball's spin there, where it is estimated; None where it is not."""
    spin_sigma_radps: Array | None = None
    """(3,) standard deviations of the spin; None where it is not estimated."""


class Flights(Protocol):
    """A flight in row 0 and its neighbours, one sigma away along each unknown, in pairs."""

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at times (K,)."""
        ...

    def crossings(self, xs_m: Array) -> tuple[Array, Array]:
        """(K, D) time and state at planes (K,), descending x, and (K, D, D) its covariance; nan where it never is.

        D is 10 with the spin, 7 for flights without one.
        """
        ...

    def nominal(self) -> Flights:
        """Row 0 alone: the flight without its neighbours."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Predicted flight after the newest observation."""

    t_us: int
    """Time of the newest observation: nothing later is in it."""
    stage: Stage
    bounces: tuple[TablePoint, ...]
    """Bounces on the table after the newest observation."""
    landing: TablePoint | None
    """Where the ball next comes down to the table's plane, on the table or beside it."""
    hit_plane: HitPlane | None
    """None for a ball that does not come to the plane."""
    flights: Flights
    """Row 0 is the flight, rows 1 + 2 k and 2 + 2 k have unknown k changed by one sigma up and down."""

    @property
    def curve_t_s(self) -> Array:
        """(M,) from the newest observation to the hitting plane; to the landing if it does not get there."""
        now_s = self.t_us * 1e-6
        end_s = max(now_s, self.hit_plane.t_s if self.hit_plane else self.landing.t_s if self.landing else now_s)
        times = np.append(np.arange(now_s, end_s, CURVE_STEP_S), end_s)
        return np.union1d(times, [bounce.t_s for bounce in self.bounces if bounce.t_s < end_s])

    @property
    def curve_ps_world_m(self) -> Array:
        """(M, 3) where the ball is at `curve_t_s`; it ends where `hit_plane` says."""
        times = self.curve_t_s
        ps = self.flights.nominal().at(times)[0]
        if self.hit_plane is None or times[-1] <= times[0]:
            return ps
        # The mean of several flights is not quite at the plane at their mean time.
        share = (times - times[0]) / (times[-1] - times[0])
        return ps + share[:, None] * (self.hit_plane.p_world_m - ps[-1])

    def positions(self, t_s: ArrayLike) -> tuple[Array, Array]:
        """Positions (K, 3) and their standard deviations (K, 3) at times (K,)."""
        ps = self.flights.at(np.atleast_1d(np.asarray(t_s, np.float64)))
        return ps[0], np.sqrt((one_sigma_moves(ps) ** 2).sum(axis=0))

    def crossings(self, xs_m: ArrayLike) -> tuple[HitPlane | None, ...]:
        """The ball at planes (K,) of descending x; None for one that it does not come to after the observation.

        So any place along the flight can be looked at as the hitting plane is.
        """
        means, spreads = self.flights.crossings(np.asarray(xs_m, np.float64))
        return tuple(
            _crossing(mean, spread, self.stage) if mean[0] >= self.t_us * 1e-6 else None
            for mean, spread in zip(means, spreads, strict=True)
        )


def _crossing(mean: Array, spread: Array, stage: Stage) -> HitPlane:
    """From the time and state (7,) or (10,) of a crossing and its covariance."""
    sigmas = np.sqrt(np.maximum(spread.diagonal(), 0.0))
    with_spin = len(mean) == 10
    return HitPlane(
        t_s=float(mean[0]),
        sigma_t_s=float(sigmas[0]),
        p_world_m=mean[1:4],
        sigma_m=sigmas[1:4],
        v_world_mps=mean[4:7],
        sigma_mps=sigmas[4:7],
        covariance=spread[1:7, 1:7],
        stage=stage,
        spin_radps=mean[7:] if with_spin else None,
        spin_sigma_radps=sigmas[7:] if with_spin else None,
    )


class Predictor(Protocol):
    """Predicts a ball's flight from its points, one by one."""

    @property
    def latest(self) -> Prediction | None:
        """The newest prediction of this flight."""
        ...

    @property
    def bounces_us(self) -> tuple[int, ...]:
        """Bounces seen in this flight."""
        ...

    def add(self, t_us: int, p_world_m: ArrayLike, covariance_m2: Array | None = None) -> Prediction | None:
        """A new prediction if this point leads to one. Points come in order of time, maybe with their covariance."""
        ...

    def forget_flight(self) -> None:
        """Expect a new ball; what was learnt of air and table is kept."""
        ...

    def reset(self) -> None:
        """Forget everything: what was learnt of air and table too."""
        ...


def predict_flight(
    t_s: Array, ps_m: Array, newest_us: int, stage: Stage, config: PaperPredictorConfig
) -> Prediction | None:
    """Prediction from observations (K,) and (K, 3); None if they are not enough.

    Args:
        t_s: (K,) times of the positions.
        ps_m: (K, 3) positions, world.
        newest_us: time of the newest, for the prediction.
        stage: which side of the bounce they are on.
        config: table, hitting plane and noise.
    """
    fit = fit_arcs(t_s[None], ps_m[None])
    if not np.isfinite(fit.vs_mps).all():
        return None
    return _describe_flights(_spread(fit, t_s, config), newest_us, stage, config.hit_x_m)


def _describe_flights(flights: Continuation, newest_us: int, stage: Stage, hit_x_m: float) -> Prediction:
    """Bounces, landing and hitting plane, with uncertainties from a flight and its neighbours."""
    now_s = newest_us * 1e-6
    bounces = tuple(TablePoint(float(t[0]), ps[0], _sigma(ps)) for t, ps in flights.bounces() if float(t[0]) > now_s)
    t_landing, ps_landing = flights.landing(now_s)
    landing = None
    if math.isfinite(t_landing[0]):
        landing = TablePoint(float(t_landing[0]), ps_landing[0], _sigma(ps_landing))
    hit_plane = _hit_plane(flights, stage, hit_x_m)
    return Prediction(newest_us, stage, bounces, landing, hit_plane, flights)


def _spread(fit: Arcs, t_s: Array, config: PaperPredictorConfig) -> Continuation:
    """The fitted flight and its neighbours, one sigma away along each unknown."""
    dt = t_s - fit.t_s[0]
    sigmas = np.array(
        [
            *[config.sigma_point_m / math.sqrt(len(t_s))] * 3,
            *[config.sigma_point_m / math.sqrt(float(dt @ dt))] * 3,
            config.restitution_sigma,
            config.tangential_sigma,
        ]
    )
    factor = spinless_factor(fit, config) if config.friction else config.tangential_factor
    centre = np.concatenate([fit.ps_m[0], fit.vs_mps[0], [config.restitution, factor]])
    rows = np.tile(centre, (1 + 2 * UNKNOWNS, 1))
    unknown = np.arange(UNKNOWNS)
    rows[1 + 2 * unknown, unknown] += sigmas
    rows[2 + 2 * unknown, unknown] -= sigmas
    arcs = Arcs(np.full(len(rows), fit.t_s[0]), rows[:, :3], rows[:, 3:6])
    return continue_flights(arcs, rows[:, 6], rows[:, 7])


def spinless_factor(fit: Arcs, config: PaperPredictorConfig) -> float:
    """Share of the tangential speed that the table leaves: 1 - friction (1 + e) vz / v while the ball slides, 3/5 if it
    rolls.

    Of a hollow ball without spin (moment of inertia 2/3 m r^2) that comes to the table on the fitted arc.
    """
    (vx, vy, vz), z = fit.vs_mps[0], fit.ps_m[0, 2]
    down = math.sqrt(max(0.0, vz * vz + 2 * GRAVITY_MPS2 * (z - BALL_RADIUS_M)))
    along = math.hypot(vx, vy)
    push = config.friction * (1 + config.restitution) * down
    return 1 - push / along if push < 0.4 * along else 0.6


def _sigma(values: Array) -> Array:
    return np.sqrt((one_sigma_moves(values) ** 2).sum(axis=0))


def _hit_plane(flights: Continuation, stage: Stage, hit_x_m: float) -> HitPlane | None:
    t, states = flights.hits(hit_x_m)
    if not math.isfinite(t[0]):
        return None
    moves = one_sigma_moves(states)
    covariance = moves.T @ moves
    sigmas = np.sqrt(np.diag(covariance))
    return HitPlane(
        t_s=float(t[0]),
        sigma_t_s=float(_sigma(t)),
        p_world_m=states[0, :3],
        sigma_m=sigmas[:3],
        v_world_mps=states[0, 3:],
        sigma_mps=sigmas[3:],
        covariance=covariance,
        stage=stage,
    )
