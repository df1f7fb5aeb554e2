"""State of a ball at the time of the decision, as perceived by event cameras, without rendering events.

Points in space come window by window and err as those of the chain; the chain's own predictor takes them, finds the
bounce itself, and is asked at the end of every block. The racket sets off on the first prediction and follows every
newer one within its limits; the orientation is decided when `lead_ms` are left. Nothing of what comes later counts.

Error model of stereo points of event cameras: a part explained by position and motion of the ball, and noise. The
explained part is cubic in place and velocity (a fast edge is seen ahead of the ball, a lit one too high). What is left
has a bias per flight, a drift with a time constant, and noise from point to point, before and after the bounce.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.learning.config import EnvironmentConfig, TimingConfig
from core.learning.task.drawn_worlds import sample_differing_serves
from core.physics.episode import Arrivals, Serves, orientations_from_actions
from core.simulation.episodes.racket import (
    RacketConfig,
    RacketTarget,
    check_target,
    move_racket,
    target_for_ball,
    upright_racket,
)
from core.trajectory import FilterPredictor, HitPlane, PaperPredictor, Predictor, predictor_for, with_physics
from core.trajectory.config import published_predictor
from core.trajectory.filter_config import refined_filter

Array = NDArray[np.float64]
MOTION_SCALE: Final = np.array([1.0, 1.0, 1.0, 5.0, 2.0])
"""Scales of the variables that explain errors: x, y, z and the velocity along x and z (along y a ball hardly moves)."""
DEGREE: Final = 3
"""Largest degree of the products of the five variables."""
FEATURES: Final = 56
"""Products of up to this degree, and one."""


@dataclass(frozen=True, slots=True, eq=False)
class PointErrors:
    """All in millimetres along x, y, z; rows of (2, 3) are before and after the bounce."""

    explained: Array
    """(2, 56, 3) of `place_and_motion`."""
    bias: Array
    """(2, 3) standard deviation from flight to flight."""
    drift: Array
    """(2, 3)."""
    drift_s: float
    noise: Array
    """(2, 3)."""

    def draw(self, t_s: Array, truth_m: Array, bounce_t_s: Array, rng: np.random.Generator) -> Array:
        """Errors (N, K, 3) in metres of N balls at times (K,) in rising order, their places (N, K, 3) given.

        Args:
            t_s: (K,) times, ascending.
            truth_m: (N, K, 3) true places, world.
            bounce_t_s: (N,) when each ball bounces.
            rng: source of random numbers.
        """
        n, k = truth_m.shape[:2]
        after = (t_s > bounce_t_s[:, None]).astype(np.int8)
        features = np.stack([place_and_motion(t_s, one) for one in truth_m]) if n else np.empty((0, k, FEATURES))
        explained = np.where(after[..., None] == 1, features @ self.explained[1], features @ self.explained[0])
        bias = rng.standard_normal((n, 1, 3))
        steps, noise = rng.standard_normal((2, n, k, 3))
        drift = steps.copy()
        for i in range(1, k):
            kept = np.exp(-(t_s[i] - t_s[i - 1]) / self.drift_s)
            drift[:, i] = kept * drift[:, i - 1] + np.sqrt(1 - kept * kept) * steps[:, i]
        return 1e-3 * (explained + self.bias[after] * bias + self.drift[after] * drift + self.noise[after] * noise)


def place_and_motion(t_s: Array, truth_m: Array) -> Array:
    """(K, 56): one, and the products of where the ball is and how fast it goes, by two neighbouring places."""
    steps = np.diff(truth_m, axis=0) / np.diff(t_s)[:, None] if len(t_s) > 1 else np.zeros((1, 3))
    v = np.vstack([steps, steps[-1:]])[: len(t_s)]
    motion = (np.column_stack([truth_m, v[:, [0, 2]]]) / MOTION_SCALE).T
    products = [
        np.prod(motion[list(which)], axis=0)
        for degree in range(1, DEGREE + 1)
        for which in itertools.combinations_with_replacement(range(len(motion)), degree)
    ]
    return np.column_stack([np.ones(len(t_s)), *products])


MEASURED: Final = PointErrors(
    explained=np.array([
        [
            [0.121, 0.003, -0.172], [0.189, -0.019, -0.098], [0.036, -0.187, 0.034], [-0.198, -0.011, 0.255],
            [-0.250, 0.010, -0.112], [-0.048, -0.048, -0.238], [0.157, -0.050, 0.026], [0.216, -1.372, -0.047],
            [0.214, 0.121, -0.754], [-0.100, -0.029, -0.114], [-0.271, 0.025, -0.386], [0.375, 0.223, 0.645],
            [0.089, 1.169, 0.096], [0.115, 0.412, -0.016], [-0.086, 0.757, 0.035], [-0.521, 0.520, -0.648],
            [-0.624, -0.121, -0.543], [-0.872, 0.324, -1.186], [0.033, 0.003, 0.022], [-0.085, -0.008, -0.037],
            [-0.153, 0.012, -0.038], [0.108, 0.063, 0.072], [-0.091, 0.108, -0.105], [0.497, 0.127, 0.632],
            [0.303, 0.018, 0.100], [0.020, -0.035, -0.269], [-0.645, -0.321, 0.330], [-0.134, 1.473, 0.050],
            [0.018, -0.129, -0.011], [0.175, 0.671, 0.052], [1.170, -0.212, -0.567], [0.375, 0.149, 0.519],
            [-0.477, -0.041, -2.063], [-0.106, -0.002, -0.033], [-0.133, 0.017, -0.025], [-0.174, -0.030, -0.232],
            [0.031, -0.426, 0.035], [-0.343, -1.055, -0.348], [0.464, -0.309, 0.049], [0.448, 0.392, 0.355],
            [0.379, -0.789, -0.706], [0.484, -0.862, -0.086], [-0.017, 0.915, 0.033], [0.132, 0.068, 0.018],
            [-0.019, 0.156, -0.044], [-0.055, 0.242, 0.030], [0.549, -1.197, -0.869], [-0.409, -0.189, 0.858],
            [-0.465, -0.570, 1.373], [-0.158, -0.103, -0.229], [-0.813, 0.047, -0.497], [-0.000, -0.103, 0.392],
            [0.009, -0.004, -0.002], [0.001, -0.006, 0.010], [-0.035, 0.005, 0.002], [-0.060, 0.001, 0.060],
        ],
        [
            [0.349, -0.004, -0.247], [0.125, -0.025, -0.186], [-0.163, -0.301, 0.073], [0.074, -0.118, 0.262],
            [0.071, 0.030, -0.056], [-0.105, -0.021, 0.089], [-0.079, -0.005, -0.013], [0.000, -0.176, -0.074],
            [0.322, 0.215, 0.240], [0.035, 0.047, 0.010], [0.126, 0.012, -0.027], [-0.132, 0.079, 0.829],
            [-0.185, -2.309, 0.547], [0.110, 0.370, 0.146], [-0.002, 0.063, -0.209], [-0.726, -1.166, 0.260],
            [0.697, -0.269, 0.090], [1.591, 1.451, 1.830], [0.016, -0.001, 0.025], [0.016, 0.047, -0.058],
            [-0.102, -0.042, -0.098], [0.054, -0.019, -0.013], [0.045, 0.817, -0.028], [-0.359, -0.138, -0.177],
            [-0.226, -0.052, -0.023], [-0.065, -0.056, -0.413], [-1.113, -0.282, 0.755], [0.221, -2.091, 0.623],
            [-0.075, 0.481, -0.037], [-0.170, -0.201, -0.118], [0.615, 0.522, -0.015], [1.255, 0.321, 0.402],
            [0.059, -0.503, 2.366], [0.061, -0.017, -0.011], [0.003, 0.003, -0.115], [0.282, -0.011, -0.015],
            [0.339, -0.598, 0.028], [-3.848, -1.572, 1.229], [0.702, 0.153, -0.157], [0.138, -0.003, -0.026],
            [1.192, 4.316, 0.385], [-1.008, -4.844, -0.155], [-0.688, -4.385, -0.389], [0.104, -0.502, 0.082],
            [0.038, -0.929, -0.066], [0.072, -0.812, 0.075], [5.839, 3.033, 5.201], [-1.373, -4.128, -5.932],
            [-3.916, -3.667, -6.161], [-1.511, -0.864, -0.270], [-2.137, 2.126, -0.238], [-0.659, 0.344, 1.393],
            [-0.039, -0.001, -0.015], [0.069, 0.080, -0.012], [0.015, -0.083, 0.090], [0.237, -0.050, 0.112],
        ],
    ]),
    bias=np.array([[0.021, 0.027, 0.020], [0.036, 0.081, 0.046]]),
    drift=np.array([[0.053, 0.119, 0.094], [0.062, 0.154, 0.094]]),
    drift_s=0.006,
    noise=np.array([[0.066, 0.080, 0.068], [0.047, 0.094, 0.055]]),
)  # fmt: skip
"""Errors of the chain with the detector `refined` and cameras of the `side` placement: fitted by
`benchmarks/learning/point_errors.py` to 242 standard serves at 3, 5 and 9 m/s."""


COVARIANCE_M2: Final = np.diag([0.13e-3, 0.34e-3, 0.21e-3]) ** 2
"""Median covariance of the chain's triangulated points; the filter adds its own error terms."""


@dataclass(frozen=True, slots=True, eq=False)
class StatesInTime:
    """States of N balls at their decisions; zeros and NaN for a ball that was not predicted in time."""

    seen: NDArray[np.bool_]
    states: Array
    """(N, 6) p_c and v_c."""
    aim_ps_m: Array
    """(N, 3) where the racket will be at `aim_t_s`: where the ball is expected, or as far as it gets."""
    aim_t_s: Array
    decided_t_s: Array
    """(N,) when, after the launch."""
    spins_radps: Array
    """(N, 3) as the predictor estimates them; zeros with the paper's, which does not."""
    spin_sigmas_radps: Array


def observe_in_time(
    serves: Serves,
    arrivals: Arrivals,
    config: EnvironmentConfig,
    racket_speeds_mps: ArrayLike,
    rng: np.random.Generator,
    hit_xs_m: Array | None = None,
    constants: Array | None = None,
) -> StatesInTime:
    """Every ball up to its decision; the racket meets each at a speed of its own (N,), or all at one.

    Args:
        serves: N launches.
        arrivals: of the same balls at the hitting plane.
        config: timing, predictor and task.
        racket_speeds_mps: (N,) or one, along +x.
        rng: source of random numbers.
        hit_xs_m: (N,) x of the place where each ball is met; None: the hitting plane.
        constants: (N, 5) of each ball's world, which the predictor does not know; None: those of the task.
    """
    n = len(arrivals.t_s)
    rackets_mps = np.broadcast_to(np.asarray(racket_speeds_mps, np.float64), n)
    timing = config.timing
    latest_s = float(np.nanmax(arrivals.t_s, initial=0.0))
    first_s, window_s = 1e-3 * timing.first_seen_ms, 1e-3 * timing.window_ms
    t_s = first_s + window_s * np.arange(max(0, int((latest_s - first_s) / window_s)), dtype=np.float64)
    until_s = np.broadcast_to(t_s, (n, len(t_s)))
    flown_s = np.minimum(until_s, arrivals.t_s[:, None])
    truth_m = sample_differing_serves(serves, arrivals, flown_s, config.task, constants)
    errors_m = timing.error_scale * MEASURED.draw(t_s, truth_m, arrivals.bounce_t_s, rng)
    # No points before the cameras see the ball.
    points_m = np.where(truth_m[..., :1] < timing.seen_from_x_m, truth_m + errors_m, np.nan)
    found = StatesInTime(
        np.zeros(n, np.bool_),
        np.zeros((n, 6)),
        np.full((n, 3), np.nan),
        np.full(n, np.nan),
        np.full(n, np.nan),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
    )
    predictor = make_predictor(config)
    q_wxyz = orientations_from_actions(np.zeros((1, 3)), config.task.stroke)[0]
    for i in range(n):
        x_m = None if hit_xs_m is None else float(hit_xs_m[i])
        racket = FollowingRacket(q_wxyz, float(rackets_mps[i]))
        _watch(found, i, t_s, points_m[i], float(arrivals.t_s[i]), predictor, timing, racket, x_m)
    return found


def make_predictor(config: EnvironmentConfig) -> Predictor:
    """The chain's filter for this physics, or the paper's rule as published."""
    hit_x_m, physics = config.task.stroke.hit_plane_x_m, config.task.physics
    name = "real" if physics.has_air else "paper"
    if config.timing.predictor == "paper":
        return PaperPredictor(
            replace(predictor_for("real") if physics.has_air else published_predictor(), hit_x_m=hit_x_m)
        )
    air, table = physics.air, physics.table
    filter_config = replace(
        with_physics(refined_filter(), name),
        drag=air.drag_coefficient,
        magnus=air.magnus_coefficient,
        restitution=table.restitution,
        friction=table.friction,
        perhaps_real=False,
    )
    return FilterPredictor(filter_config, hit_x_m=hit_x_m)


def _watch(
    found: StatesInTime,
    i: int,
    t_s: Array,
    points_m: Array,
    arrives_s: float,
    predictor: Predictor,
    timing: TimingConfig,
    racket: FollowingRacket,
    hit_x_m: float | None,
) -> None:
    """One ball, block by block, until the stroke is decided or the ball is past; fills in row i."""
    predictor.forget_flight()
    block_s, k = 1e-3 * timing.block_ms, 0
    seen: HitPlane | None = None
    for block in range(1, 1 + int(arrives_s / block_s)):
        end_s = block * block_s
        racket.move(end_s)
        newest = None
        # All points of a block at once and only the newest prediction: what the live chain does.
        while k < len(t_s) and t_s[k] <= end_s:
            if np.isfinite(points_m[k, 0]):
                prediction = predictor.add(round(1e6 * t_s[k]), points_m[k], COVARIANCE_M2)
                if prediction is not None:
                    met = prediction.hit_plane if hit_x_m is None else prediction.crossings([hit_x_m])[0]
                    newest = met or newest
            k += 1
        if newest is not None:
            seen = newest
            racket.aim(seen.p_world_m, seen.t_s)
        if seen is not None and seen.t_s - end_s < 1e-3 * timing.lead_ms:
            found.seen[i] = True
            found.states[i] = np.concatenate([seen.p_world_m, seen.v_world_mps])
            found.aim_ps_m[i], found.aim_t_s[i] = seen.p_world_m + racket.short_of_m(), seen.t_s
            found.decided_t_s[i] = end_s
            if seen.spin_radps is not None and seen.spin_sigma_radps is not None:
                found.spins_radps[i], found.spin_sigmas_radps[i] = seen.spin_radps, seen.spin_sigma_radps
            return


class FollowingRacket:
    """A racket that follows the predicted ball within the limits of `RacketConfig`; it starts at rest."""

    def __init__(self, q_wxyz: Array, speed_mps: float, config: RacketConfig | None = None) -> None:
        self._config = config or RacketConfig()
        self._q, self._v = q_wxyz, np.array([speed_mps, 0.0, 0.0])
        self._state = replace(upright_racket(self._config), q_wxyz=q_wxyz)
        self._target: RacketTarget | None = None
        self._now_s = 0.0

    def aim(self, ball_p_m: Array, t_s: float) -> None:
        """Meet a ball expected there and then; a target beyond the limits is refused, and the old one stays."""
        try:
            self._target = check_target(target_for_ball(ball_p_m, self._q, self._v, t_s), self._config)
        except ConfigError:
            return

    def move(self, t_s: float) -> None:
        """Simulate up to this time."""
        if self._target is not None:
            self._state = move_racket(self._state, self._target, self._now_s, t_s - self._now_s, self._config, self._q)
        self._now_s = t_s

    def short_of_m(self, step_s: float = 0.002) -> Array:
        """(3,) from where the face is to be at the time of the impact to where it will be: zero if it gets there."""
        if self._target is None:
            return np.zeros(3)
        state, now_s = self._state, self._now_s
        while now_s < self._target.t_s - 1e-9:
            h = min(step_s, self._target.t_s - now_s)
            state = move_racket(state, self._target, now_s, h, self._config, self._q)
            now_s += h
        return state.p_m - self._target.p_m


def turned_share(angles_rad: Array, turn_s: Array, config: RacketConfig | None = None) -> Array:
    """(N,) share of the turn (N, 3) that a racket makes in the time after the decision, at its largest rate."""
    wanted = np.linalg.norm(angles_rad, axis=1)
    able = (config or RacketConfig()).max_turn_rate_radps * np.maximum(turn_s, 0.0)
    return np.divide(able, wanted, out=np.ones_like(wanted), where=wanted > able)
