"""A recursive filter of the ball: drag, Magnus, spin from the flight, a bounce that knows spin, honest covariance.

A prediction comes from a mixture of estimates of a flight. The first two moments of a mixture of normal distributions
are exact here, of what is touched and of every position.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.trajectory.ball_filter import SETTLED, BallFilter
from core.trajectory.ball_kernel import STATE, TOUCHES, crossings, places
from core.trajectory.continuation import one_sigma_moves
from core.trajectory.filter_config import FilterConfig
from core.trajectory.filter_kernel import ROWS, foresee
from core.trajectory.learned_constants import nothing_learned
from core.trajectory.observation import Observation, PixelObservation, PointObservation
from core.trajectory.prediction import HitPlane, Prediction, Stage, TablePoint

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """The estimate and its sigma points (one sigma along each independent direction), with what they touch."""

    t_s: float
    states: Array
    """(27, 14)."""
    lift: float

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at ascending times (K,), not before the newest observation."""
        ps = np.empty((len(self.states), len(t_s), 3))
        places(self.states, self.t_s, np.ascontiguousarray(t_s), self.lift, ps)
        return ps

    def crossings(self, xs_m: Array) -> tuple[Array, Array]:
        """(K, 10) time and state at planes (K,), descending x, and (K, 10, 10) its covariance; nan where none is."""
        found = np.empty((len(self.states), len(xs_m), 10))
        crossings(self.states, self.t_s, np.ascontiguousarray(xs_m), self.lift, found)
        moves = one_sigma_moves(found)
        return found[0], np.einsum("nki,nkj->kij", moves, moves)

    def nominal(self) -> Paths:
        """The estimate alone, without its neighbours."""
        return Paths(self.t_s, self.states[:1], self.lift)


@dataclass(frozen=True, slots=True, eq=False)
class Foreseen:
    """Next contacts of one estimate."""

    weight: float
    """Its probability in the mixture."""
    found: Array
    """(22,), see `ball_kernel.touches`."""
    spread: Array
    """(22, 22) covariance of `found`."""
    paths: Paths


@dataclass(frozen=True, slots=True, eq=False)
class MixedPaths:
    """Several estimates and their neighbours as one.

    Row 0 is the mean; pairs of rows are what each of them, and their distances from the mean, add to the variance.
    """

    weights: Array
    """(M,) sum 1."""
    parts: tuple[Paths, ...]

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at ascending times (K,), not before the newest observation."""
        each = [part.at(t_s) for part in self.parts]
        mean = np.einsum("m,mkj->kj", self.weights, np.array([ps[0] for ps in each]))
        rows = [mean[None]]
        for weight, ps in zip(self.weights, each, strict=True):
            moves = np.sqrt(weight) * np.concatenate([ps[:1] - mean, (ps[1::2] - ps[2::2]) / 2])
            rows.append(np.stack([mean + moves, mean - moves], axis=1).reshape(2 * len(moves), *mean.shape))
        return np.concatenate(rows)

    def crossings(self, xs_m: Array) -> tuple[Array, Array]:
        """(K, 10) time and state at planes (K,), descending x, and (K, 10, 10) its covariance; nan where none is.

        Estimates that do not come to a plane to which the first one comes are left out there.
        """
        each = [part.crossings(xs_m) for part in self.parts]
        found, spread = np.array([one[0] for one in each]), np.array([one[1] for one in each])
        weights = np.where(np.isfinite(found[:, :, 0]), self.weights[:, None], 0.0)
        weights = weights / np.maximum(weights.sum(axis=0), 1e-300)
        counted = weights[..., None] > 0
        mean = np.einsum("mk,mki->ki", weights, np.where(counted, found, 0.0))
        apart = np.where(counted, found - mean, 0.0)
        covariance = np.einsum("mk,mkij->kij", weights, np.where(counted[..., None], spread, 0.0))
        covariance += np.einsum("mk,mki,mkj->kij", weights, apart, apart)
        mean[~np.isfinite(found[0, :, 0])] = np.nan
        return mean, covariance

    def nominal(self) -> MixedPaths:
        """The mean, and what the distances from it say: without the neighbours of each."""
        return MixedPaths(self.weights, tuple(part.nominal() for part in self.parts))


def mix(parts: Sequence[Foreseen]) -> tuple[Array, Array, Paths | MixedPaths]:
    """What all together touch (22,), its covariance (22, 22), and their paths.

    The first one says what is touched: others that touch something else are left out.
    """
    there = np.isfinite(parts[0].found)
    alike = [part for part in parts if (np.isfinite(part.found) == there).all()]
    if len(alike) == 1:
        return alike[0].found, alike[0].spread, alike[0].paths
    weights = np.array([part.weight for part in alike])
    weights /= weights.sum()
    all_found = np.array([part.found for part in alike])
    found = weights @ all_found
    apart = np.where(there, all_found - found, 0.0)
    spread = np.einsum("m,mij->ij", weights, np.array([part.spread for part in alike]))
    spread += (apart * weights[:, None]).T @ apart
    return found, spread, MixedPaths(weights, tuple(part.paths for part in alike))


STRAYS: Final = 5
"""Consecutive outliers that begin a new flight."""
SLOWEST_MPS: Final = 1.0
"""A slower ball counts as this fast where an error of place becomes one of time, which had no bound else. Chosen by
hand; not measured."""
IMPOSSIBLE: Final = math.log(1e-6)
"""A kind of flight with smaller odds against another is dropped."""
MIN_SHARE: Final = 0.02
"""A less probable kind of flight is not part of the prediction."""
LONG_AGO_US: Final = -(1 << 62)
SPIN_Y: Final = 20
"""Index of the spin about y at the hitting plane."""
NOTHING: Final = np.full((STATE, STATE), np.nan)


class BallPosition(NamedTuple):
    """Where the ball is by the estimate."""

    p_world_m: Array
    """(3,)."""
    covariance_m2: Array
    """(3, 3)."""


class FilterPredictor:
    """Fed point by point like `PaperPredictor`; every point moves the estimate.

    Filters for several kinds of flights run side by side: one that the model describes, one of which it leaves a good
    deal out. The one that explains the points best is believed. Where nothing was said of air and table there are more
    of them, and what is predicted is the mean of all, each as probable as the points make it.
    """

    def __init__(self, config: FilterConfig | None = None, *, hit_x_m: float = -1.42) -> None:
        self.config = config or FilterConfig()
        self._hit_x_m = hit_x_m
        self._noise_m2 = self.config.sigma_point_m**2 * np.eye(3)
        self._floor_m2 = self.config.noise_m**2 * np.eye(3)
        self.reset()

    def reset(self) -> None:
        """Forget everything: what was learnt of air and table too."""
        self._filters: tuple[BallFilter, ...] = ()
        self.learned = nothing_learned(self.config)
        """Constants of air and table learned from the flights before this one."""
        self.forget_flight()

    def forget_flight(self) -> None:
        """Expect a new ball; what was learnt of air and table is kept, and updated by this flight."""
        self._learn()
        self.latest: Prediction | None = None
        self._filters, self._predicted_us = (), 0

    @property
    def believed(self) -> BallFilter | None:
        """The filter that explains the flight best; None before there is a point."""
        return max(self._filters, key=self._evidence, default=None)

    @property
    def newest_us(self) -> int:
        """Time of the estimate; long ago before there is a point."""
        return self._filters[0].t_us if self._filters else LONG_AGO_US

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
        """(3,) ratio of the observations' variances to their stated ones, from the innovations of this flight."""
        return self.believed.noise_scales if self.believed else np.ones(3)

    @property
    def bounces_us(self) -> tuple[int, ...]:
        """Times of the bounces in this flight."""
        return self.believed.bounces_us if self.believed else ()

    @property
    def stage(self) -> Stage:
        """Before or after the first observed bounce."""
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
        self._update(t_us, PointObservation(p, noise))
        if all(one.strays >= STRAYS for one in self._filters):
            self._learn()
            self._begin(t_us, p, noise)
        return self.predict_if_due()

    def add_pixel(self, t_us: int, seen: PixelObservation, *, max_late_us: int = 0) -> bool:
        """Whether the pixel of one camera moved the estimate.

        It does not in a flight of too few points, around a bounce, or beyond its gate. A pixel older than the estimate
        is used up to `max_late_us`, unless there was a bounce since.
        """
        ball = self.believed
        if ball is None or ball.points < SETTLED:
            return False
        late_us = max(0, ball.t_us - t_us)
        if late_us:
            bounces_us = [one.bounces_us[-1] for one in self._filters if one.bounces_us]
            if (
                late_us > max_late_us
                or t_us < max(bounces_us, default=t_us)
                or any(one.is_asking for one in self._filters)
            ):
                return False
            seen = dataclasses.replace(seen, late_s=1e-6 * late_us)
        self._update(max(t_us, ball.t_us), seen)
        believed = self.believed
        return believed is not None and believed.accepted

    def position(self) -> BallPosition | None:
        """Where the ball is at the newest time, by all kinds of flights that count; None before there is a point."""
        shares = self.shares()
        if not shares:
            return None
        weights = np.array([weight for _, weight in shares])
        weights /= weights.sum()
        ps = np.array([one.state[:3] for one, _ in shares])
        p = weights @ ps
        spread = np.array([one.covariance[:3, :3] for one, _ in shares]) + np.einsum("ni,nj->nij", ps - p, ps - p)
        return BallPosition(p, np.einsum("n,nij->ij", weights, spread))

    def predict_if_due(self) -> Prediction | None:
        """A new prediction, not too soon after the one before and not while a bounce is undecided; else None."""
        ball = self.believed
        due = ball is not None and ball.t_us - self._predicted_us >= 1e3 * self.config.every_ms
        return self.predict() if due and not any(one.is_asking for one in self._filters) else None

    def _update(self, t_us: int, seen: Observation) -> None:
        before = [one.log_odds for one in self._filters]
        for one in self._filters:
            one.take(t_us, seen)
        if self.config.perhaps_real:
            if not all(one.spoke for one in self._filters):  # not compared by such an observation
                for one, odds in zip(self._filters, before, strict=True):
                    one.log_odds = odds
            self._filters = self._possible()

    def predict(self) -> Prediction | None:
        """Current prediction; None before enough points."""
        ball = self.believed
        if ball is None or ball.t_us - ball.first_us < 1e3 * self.config.least_seen_ms:
            return None
        self._predicted_us = ball.t_us
        found, spread, paths = mix([self._foresee(one, weight) for one, weight in self.shares()])
        if math.isfinite(found[13]):
            found[13] = self._hit_x_m
        _add_bias(spread, float(ball.state[5]), float(found[16]), self.config.bias_m)
        spread[SPIN_Y, SPIN_Y] += self.config.spin_bias_radps**2
        self.latest = _describe(found, spread, ball.t_us, self.stage, paths)
        return self.latest

    def shares(self) -> list[tuple[BallFilter, float]]:
        """Filters used for the prediction with their probabilities, the most probable first."""
        best = self.believed
        if best is None or not self.config.perhaps_real:
            return [] if best is None else [(best, 1.0)]
        weights = self._weights()
        counted = [
            (one, weight)
            for one, weight in weights.items()
            if one is not best and weight > MIN_SHARE and len(one.bounces_us) == len(best.bounces_us)
        ]
        return [(best, weights[best]), *counted]

    @property
    def air(self) -> float:
        """Probability that the ball flies through air, by this flight up to now and those before it."""
        if not self._filters or not self.config.perhaps_real:
            return self.learned.air
        return sum(weight for one, weight in self._weights().items() if one.process_noise.lift > 0)

    def _learn(self) -> None:
        """Update the learned constants with this flight, where they are learned."""
        if (best := self.believed) is not None and self.config.perhaps_real:
            self.learned = self.learned.after(best, self._weights()[best], self.air)

    def _possible(self) -> tuple[BallFilter, ...]:
        """Filters without those that cannot become probable again."""
        least = max(self._evidence(one) for one in self._filters) + IMPOSSIBLE
        return tuple(one for one in self._filters if self._evidence(one) >= least)

    def _evidence(self, one: BallFilter) -> float:
        """Log probability of a kind of flight, up to a constant; points have correlated errors."""
        alike = self.config.alike_points if self.config.perhaps_real else 1.0
        return one.prior + (one.log_odds - one.prior) / alike

    def _weights(self) -> dict[BallFilter, float]:
        evidence = {one: self._evidence(one) for one in self._filters}
        best = max(evidence.values())
        weights = {one: math.exp(value - best) for one, value in evidence.items()}
        total = sum(weights.values())
        return {one: weight / total for one, weight in weights.items()}

    def _foresee(self, ball: BallFilter, weight: float) -> Foreseen:
        rows, spread = np.empty((ROWS, STATE)), np.empty((TOUCHES, TOUCHES))
        now_s, lift = ball.t_us * 1e-6, ball.process_noise.lift
        found = foresee(ball.state, ball.covariance, now_s, self._hit_x_m, lift, rows, spread)
        return Foreseen(weight, found, spread, Paths(now_s, rows, lift))

    def _begin(self, t_us: int, p: Array, noise: Array) -> None:
        c = self.config
        if c.perhaps_real:
            self._filters = tuple(
                BallFilter(kind, t_us, p, noise, needs_tick=False, odds=odds) for kind, odds in self.learned.kinds(c)
            )
        else:
            odds = {False: 1.0, True: c.restless_odds} if c.restless_odds > 0 else {False: 1.0}
            self._filters = tuple(
                BallFilter(c, t_us, p, noise, needs_tick=needs_tick, odds=odds[needs_tick]) for needs_tick in odds
            )
        self._predicted_us = t_us


def _add_bias(spread: Array, falling_mps: float, hit_mps: float, bias_m: float) -> None:
    """Add to the covariance (22, 22) of what is touched that all points may be off: so are place and time.

    By the velocities down onto the table, and through the hitting plane.
    """
    for first, velocity_mps in ((0, falling_mps), (4, falling_mps), (8, falling_mps), (12, hit_mps)):
        spread[first, first] += (bias_m / max(abs(velocity_mps), SLOWEST_MPS)) ** 2
        for axis in range(first + 1, first + 4):
            spread[axis, axis] += bias_m**2


def _describe(found: Array, spread: Array, newest_us: int, stage: Stage, paths: Paths | MixedPaths) -> Prediction:
    """Named fields of the result of `foresee`."""
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
            spin_sigma_radps=sigmas[19:22],
        )
    bounces = tuple(point for point in points[:2] if point is not None)
    return Prediction(newest_us, stage, bounces, points[2], hit_plane, paths)
