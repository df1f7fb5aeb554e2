"""State of a ball at the time of the decision, as perceived by event cameras, without rendering events.

Points in space come window by window and err as those of the chain; the chain's own predictor takes them, finds the
bounce itself, and is asked at the end of every block. The racket sets off on the first prediction and follows every
newer one within its limits; the orientation is decided when `lead_ms` are left. Nothing of what comes later counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.learning.config import EnvironmentConfig, TimingConfig
from core.learning.task.point_errors import MEASURED
from core.physics.episode import Arrivals, Serves, orientations_from_actions
from core.simulation.episodes.closed_form import sample_serves
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
from core.trajectory.stereo_filters import refined_filter

Array = NDArray[np.float64]

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
) -> StatesInTime:
    """Every ball up to its decision; the racket meets each at a speed of its own (N,), or all at one."""
    n = len(arrivals.t_s)
    rackets_mps = np.broadcast_to(np.asarray(racket_speeds_mps, np.float64), n)
    timing = config.timing
    latest_s = float(np.nanmax(arrivals.t_s, initial=0.0))
    first_s, window_s = 1e-3 * timing.first_seen_ms, 1e-3 * timing.window_ms
    t_s = first_s + window_s * np.arange(max(0, int((latest_s - first_s) / window_s)), dtype=np.float64)
    until_s = np.broadcast_to(t_s, (n, len(t_s)))
    truth_m = sample_serves(serves, arrivals, np.minimum(until_s, arrivals.t_s[:, None]), config.task)
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
        _watch(found, i, t_s, points_m[i], float(arrivals.t_s[i]), predictor, timing, q_wxyz, float(rackets_mps[i]))
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
    q_wxyz: Array,
    racket_speed_mps: float,
) -> None:
    """One ball, block by block, until the stroke is decided or the ball is past; fills in row i."""
    predictor.reset()
    racket = FollowingRacket(q_wxyz, racket_speed_mps)
    block_s, k = 1e-3 * timing.block_ms, 0
    seen: HitPlane | None = None
    for block in range(1, 1 + int(arrives_s / block_s)):
        end_s = block * block_s
        racket.move(end_s)
        newest = None
        while k < len(t_s) and t_s[k] <= end_s:
            if np.isfinite(points_m[k, 0]):
                prediction = predictor.add(round(1e6 * t_s[k]), points_m[k], COVARIANCE_M2)
                if prediction is not None and prediction.hit_plane is not None:
                    newest = prediction.hit_plane
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
