"""Perception of an arriving ball: p_c, v_c and the time of arrival."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.geometry import random_direction
from core.learning.config import EnvironmentConfig, StateKind
from core.learning.randomisation import RandomisationConfig
from core.learning.task.drawn_worlds import sample_differing_serves
from core.learning.task.normalise import STATE_SIZES
from core.learning.task.timed_points import observe_in_time
from core.physics.episode import Arrivals, Serves
from core.physics.task import TaskConfig
from core.trajectory import HitPlane, predict_arrivals, predictor_for

Array = NDArray[np.float64]

POINTS: Final = predictor_for("paper").observations


def predict_serves(
    serves: Serves,
    arrivals: Arrivals,
    step_s: float,
    config: TaskConfig,
    hit_xs_m: Array | None = None,
    constants: Array | None = None,
) -> tuple[Array, Array]:
    """Predicted states (N, 6) at the hitting plane and times (N,) there; NaN with fewer than two observations.

    Args:
        serves: N launches.
        arrivals: of the same balls at the hitting plane.
        step_s: time between two observations.
        config: physics and hitting plane.
        hit_xs_m: (N,) x of the place where each ball is met; None: the hitting plane.
        constants: (N, 5) of each ball's world, which the prediction does not know; None: those of the physics.
    """
    first = np.floor(arrivals.bounce_t_s / step_s) + 1.0
    t_s: Array = (first[:, None] + np.arange(POINTS)) * step_s
    observed = t_s < arrivals.t_s[:, None]
    seen_s = np.where(observed, t_s, arrivals.bounce_t_s[:, None])
    ps_m = sample_differing_serves(serves, arrivals, seen_s, config, constants)
    table = predictor_for("real" if config.physics.has_air else "paper")
    return predict_arrivals(
        t_s,
        ps_m,
        observed,
        hit_x_m=config.stroke.hit_plane_x_m if hit_xs_m is None else hit_xs_m,
        restitution=table.restitution,
        tangential_factor=table.tangential_factor,
    )


@dataclass(frozen=True, slots=True, eq=False)
class PerceivedArrivals:
    """Perceived states of arriving balls before the stroke."""

    seen: NDArray[np.bool_]
    """(N,) whether the ball was seen; an unseen ball is missed."""
    states: Array
    """(N, 6) p_c and v_c at the hitting plane, with spin (N, 12); zeros where not seen."""
    aim_ps_m: Array | None
    """(N, 3) where the racket goes; None: it meets every ball in the middle."""
    aim_t_s: Array | None
    """(N,) when it is there."""
    turn_s: Array | None = None
    """(N,) time left for the racket to turn after the decision, s; None: unlimited."""


def perceive(
    serves: Serves,
    arrivals: Arrivals,
    config: EnvironmentConfig,
    rng: np.random.Generator,
    *,
    racket_speeds_mps: Array,
    constants: Array | None = None,
) -> PerceivedArrivals:
    """The arriving balls through the configured source; of `events` nothing is known before cameras have seen them.

    Args:
        serves: N launches.
        arrivals: of the same balls at the hitting plane.
        config: state source and its errors.
        rng: source of random numbers.
        racket_speeds_mps: (N,) along +x.
        constants: (N, 5) of each ball's world, `drawn_worlds.CONSTANTS`; None: those of the task.
    """
    truth, spins = arrivals.observations, arrivals.states[:, 6:]
    n, has_spin = len(truth), config.state == "spin"
    if config.state_source == "truth":
        states = with_spin(truth, spins, np.zeros((n, 3))) if has_spin else truth
        return PerceivedArrivals(np.ones(n, np.bool_), states, None, None)
    if config.state_source == "truth+noise":
        speed = np.linalg.norm(truth[:, 3:], axis=1, keepdims=True)
        noise = rng.standard_normal((n, 6))
        scale = np.hstack([np.full((n, 3), config.position_noise_m), np.repeat(config.velocity_noise * speed, 3, 1)])
        states = truth + noise * scale
        # p_c lies in the hitting plane by definition: an error along x is one of the time at which the ball gets there.
        late_s = (states[:, 0] - truth[:, 0]) / np.abs(truth[:, 3])
        states[:, 0] = truth[:, 0]
        aims_m = states[:, :3].copy()
        if has_spin:
            sigmas = rng.uniform(0, 2 * config.spin_noise_radps, (n, 3))
            states = with_spin(states, spins + sigmas * rng.standard_normal((n, 3)), sigmas)
        return PerceivedArrivals(np.ones(n, np.bool_), states, aims_m, arrivals.t_s + late_s)
    if config.state_source == "timed":
        places_x_m = _places_x_m(arrivals, config)
        found = observe_in_time(serves, arrivals, config, racket_speeds_mps, rng, places_x_m, constants)
        left_s = found.aim_t_s - found.decided_t_s
        states = with_spin(found.states, found.spins_radps, found.spin_sigmas_radps) if has_spin else found.states
        return PerceivedArrivals(found.seen, states, found.aim_ps_m, found.aim_t_s, left_s)
    if config.state_source == "predicted":
        places_x_m = _places_x_m(arrivals, config)
        states, t_s = predict_serves(serves, arrivals, config.step_s, config.task, places_x_m, constants)
        seen = np.isfinite(t_s)
        return PerceivedArrivals(seen, np.nan_to_num(states), states[:, :3].copy(), t_s)
    nothing = np.zeros((n, STATE_SIZES[config.state]))
    return PerceivedArrivals(np.zeros(n, np.bool_), nothing, np.full((n, 3), np.nan), np.full(n, np.nan))


def _places_x_m(arrivals: Arrivals, config: EnvironmentConfig) -> Array | None:
    """(N,) x of the place where each ball is met; None: all at the hitting plane."""
    return arrivals.states[:, 0] if config.hit == "chosen" else None


def misjudge(
    perceived: PerceivedArrivals, arrivals: Arrivals, config: EnvironmentConfig, rng: np.random.Generator
) -> PerceivedArrivals:
    """The arriving balls as wrongly calibrated cameras have them, met by a racket that comes late.

    Args:
        perceived: N balls.
        arrivals: of the same balls at the hitting plane.
        config: says which of the two differs from ball to ball, and how far.
        rng: source of random numbers.
    """
    ranges, n = config.randomise, len(perceived.states)
    if not (ranges.calibration or ranges.latency):
        return perceived
    states, turn_s = perceived.states, perceived.turn_s
    aim_ps_m = states[:, :3] if perceived.aim_ps_m is None else perceived.aim_ps_m
    aim_t_s = arrivals.t_s if perceived.aim_t_s is None else perceived.aim_t_s
    if ranges.calibration:
        places_x_m = _places_x_m(arrivals, config)
        hit_xs_m = config.task.stroke.hit_plane_x_m if places_x_m is None else places_x_m
        states, late_s = _in_another_frame(states, hit_xs_m, ranges, rng)
        aim_ps_m, aim_t_s = aim_ps_m + states[:, :3] - perceived.states[:, :3], aim_t_s + late_s
    if ranges.latency:
        late_s = 1e-3 * ranges.latest_ms * rng.uniform(0, 1, n)
        aim_t_s, turn_s = aim_t_s + late_s, None if turn_s is None else turn_s - late_s
    return PerceivedArrivals(perceived.seen, states, aim_ps_m, aim_t_s, turn_s)


def _in_another_frame(
    states: Array, hit_xs_m: float | Array, ranges: RandomisationConfig, rng: np.random.Generator
) -> tuple[Array, Array]:
    """States (N, S), each in a frame that is turned and shifted, and how much later (N,) s each ball is expected."""
    n, states = len(states), states.copy()
    axes = np.array([random_direction(rng) for _ in range(n)]).reshape(n, 3)
    angles = np.radians(ranges.turned_deg) * rng.uniform(0, 1, (n, 1))
    for start in range(0, min(states.shape[1], 9), 3):  # place, velocity, spin; its standard deviations stay
        states[:, start : start + 3] = _turned(states[:, start : start + 3], axes, angles)
    states[:, :3] += ranges.shifted_m * rng.uniform(-1, 1, (n, 3))
    # p_c lies in the plane of its hit by definition: a ball that is before it is expected there later. One that was not
    # seen has no velocity.
    late_s = np.divide(hit_xs_m - states[:, 0], states[:, 3], out=np.zeros(n), where=states[:, 3] != 0)
    states[:, :3] += states[:, 3:6] * late_s[:, None]
    return states, late_s


def _turned(vectors: Array, axes: Array, angles: Array) -> Array:
    """Vectors (N, 3) turned about unit axes (N, 3) by angles (N, 1), rad: Rodrigues' formula."""
    along = axes * (axes * vectors).sum(axis=1, keepdims=True)
    return np.cos(angles) * (vectors - along) + np.sin(angles) * np.cross(axes, vectors) + along


def state_of(hit: HitPlane, kind: StateKind) -> Array:
    """The state (6,), or with spin (12,), of a ball that is predicted at the hitting plane.

    Raises:
        ConfigError: if it is to have spin, and the predictor tells none.
    """
    plain = np.concatenate([hit.p_world_m, hit.v_world_mps])
    if kind == "plain":
        return plain
    if hit.spin_radps is None or hit.spin_sigma_radps is None:
        remedy = "follow the ball with the chain's filter"
        raise ConfigError("this predictor tells no spin", expected="the state spin", where="state", remedy=remedy)
    return np.concatenate([plain, hit.spin_radps, hit.spin_sigma_radps])


def with_spin(states: Array, spins_radps: Array, sigmas_radps: Array) -> Array:
    """States (N, 12) with spin of states (N, 6): p_c, v_c, the spin there (N, 3) and its standard deviations (N, 3)."""
    return np.concatenate([states, spins_radps, sigmas_radps], axis=1)
