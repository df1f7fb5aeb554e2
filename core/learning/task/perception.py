"""How the learner gets to know an arriving ball: p_c, v_c and the time at which the racket must be there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.learning.config import EnvironmentConfig
from core.learning.task.five_points import predict_serves
from core.learning.task.timed_points import observe_in_time
from core.physics.episode import Arrivals, Serves

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PerceivedArrivals:
    """What is known of arriving balls before the stroke."""

    seen: NDArray[np.bool_]
    """(N,) whether there is anything to decide on; a ball that was not seen is missed."""
    states: Array
    """(N, 6) p_c and v_c at the hitting plane; zeros where not seen."""
    aim_ps_m: Array | None
    """(N, 3) where the racket goes; None: it meets every ball in the middle."""
    aim_t_s: Array | None
    """(N,) when it is there."""
    turn_s: Array | None = None
    """(N,) left for the racket to turn after the decision; None: as much as it needs."""


def perceive(
    serves: Serves,
    arrivals: Arrivals,
    config: EnvironmentConfig,
    rng: np.random.Generator,
    *,
    racket_speed_mps: float,
) -> PerceivedArrivals:
    """The arriving balls through the configured source; of `events` nothing is known before cameras have seen them."""
    truth = arrivals.observations
    n = len(truth)
    if config.state_source == "truth":
        return PerceivedArrivals(np.ones(n, np.bool_), truth, None, None)
    if config.state_source == "truth+noise":
        speed = np.linalg.norm(truth[:, 3:], axis=1, keepdims=True)
        noise = rng.standard_normal((n, 6))
        scale = np.hstack([np.full((n, 3), config.position_noise_m), np.repeat(config.velocity_noise * speed, 3, 1)])
        states = truth + noise * scale
        # p_c lies in the hitting plane by definition: an error along x is one of the time at which the ball gets there.
        late_s = (states[:, 0] - truth[:, 0]) / np.abs(truth[:, 3])
        states[:, 0] = truth[:, 0]
        return PerceivedArrivals(np.ones(n, np.bool_), states, states[:, :3].copy(), arrivals.t_s + late_s)
    if config.state_source == "timed":
        found = observe_in_time(serves, arrivals, config, racket_speed_mps, rng)
        left_s = found.aim_t_s - found.decided_t_s
        return PerceivedArrivals(found.seen, found.states, found.aim_ps_m, found.aim_t_s, left_s)
    if config.state_source == "predicted":
        states, t_s = predict_serves(serves, arrivals, config.step_s, config.task)
        seen = np.isfinite(t_s)
        return PerceivedArrivals(seen, np.nan_to_num(states), states[:, :3].copy(), t_s)
    return PerceivedArrivals(np.zeros(n, np.bool_), np.zeros((n, 6)), np.full((n, 3), np.nan), np.full(n, np.nan))
