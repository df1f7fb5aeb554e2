"""The one-step task for many balls at once: deliver serves, let the learner see them, play its strokes.

A delivery holds everything random about an episode (the serve, the target, the noise), so that playing an action is
deterministic: the same balls evaluate every policy, and a resumed run meets the same ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.learning.config import EnvironmentConfig, GoalConfig
from core.learning.task.perception import perceive
from core.learning.task.timed_points import turned_share
from core.physics.episode import Arrivals, Outcomes, Serves, Strokes, strokes_from_actions
from core.simulation.episodes.closed_form import fly_serves, return_balls
from core.simulation.episodes.serve import draw_serves

Array = NDArray[np.float64]

EVALUATION_SEED = 20260404
"""Of the fixed balls that every policy is evaluated on; training seeds never meet it."""
VALIDATION_SEED = 20260405
"""Of the balls by which the best policy of a run is chosen: others than it is then evaluated on."""


@dataclass(frozen=True, slots=True, eq=False)
class Deliveries:
    """Balls on their way to the robot, with what the learner knows of them and what the world holds in store."""

    speed_mps: float
    serves: Serves
    arrivals: Arrivals
    seen: NDArray[np.bool_]
    """(N,) False: nothing was perceived, and the ball is missed whatever the action."""
    states: Array
    """(N, 6) p_c and v_c as perceived."""
    aim_ps_m: Array | None
    aim_t_s: Array | None
    racket_speeds_mps: Array
    """(N,) along +x."""
    goals_m: Array
    """(N, 2)."""
    action_errors: Array
    """(N, 3) what the actuator adds, in units of the action."""
    turn_s: Array | None = None
    """(N,) left for the racket to turn after the decision; None: as much as it needs."""

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Deliveries:
        a = self.arrivals
        return Deliveries(
            self.speed_mps,
            self.serves[which],
            Arrivals(a.legal[which], a.bounce_t_s[which], a.bounce_states[which], a.t_s[which], a.states[which]),
            self.seen[which],
            self.states[which],
            None if self.aim_ps_m is None else self.aim_ps_m[which],
            None if self.aim_t_s is None else self.aim_t_s[which],
            self.racket_speeds_mps[which],
            self.goals_m[which],
            self.action_errors[which],
            None if self.turn_s is None else self.turn_s[which],
        )


def deliver(speed_mps: float, count: int, config: EnvironmentConfig, rng: np.random.Generator) -> Deliveries:
    """`count` balls of one serve speed, perceived through the configured source.

    Raises:
        ConfigError: if there are no serves of this speed.
    """
    serves = draw_serves(speed_mps, count, config.task, rng)
    arrivals = fly_serves(serves, config.task)
    racket_speed_mps = config.task.stroke.racket_speed.at(speed_mps)
    perceived = perceive(serves, arrivals, config, rng, racket_speed_mps=racket_speed_mps)
    limit_deg = config.task.stroke.action_limit_deg
    errors_deg = config.actuator_bias_deg + config.actuator_error_deg * rng.standard_normal((count, 3))
    return Deliveries(
        speed_mps,
        serves,
        arrivals,
        perceived.seen,
        perceived.states,
        perceived.aim_ps_m,
        perceived.aim_t_s,
        np.full(count, racket_speed_mps),
        draw_goals(count, config.goal, rng),
        errors_deg / limit_deg,
        perceived.turn_s,
    )


def draw_goals(count: int, config: GoalConfig, rng: np.random.Generator) -> Array:
    """Targets (count, 2) in the table's plane."""
    if config.kind == "fixed":
        return np.tile(config.centre_m, (count, 1))
    low = (config.low_x_m, -config.half_width_m)
    return rng.uniform(low, (config.high_x_m, config.half_width_m), (count, 2))


def play(deliveries: Deliveries, actions: Array, config: EnvironmentConfig) -> Outcomes:
    """What comes of actions (N, 3) in [-1, 1], one per ball; every row is played on its own."""
    strokes = strokes_of(deliveries, actions, config)
    if config.engine == "mujoco":
        from core.simulation.episodes.mujoco_episode import simulate_episodes_mujoco

        return simulate_episodes_mujoco(deliveries.serves, strokes, config.task, dt_s=config.step_s)
    return return_balls(deliveries.arrivals, strokes, config.task)


def strokes_of(deliveries: Deliveries, actions: Array, config: EnvironmentConfig) -> Strokes:
    """The strokes that actions (N, 3) become: clipped, with the actuator's error, as far as there is time to turn."""
    real = np.clip(actions, -1, 1) + deliveries.action_errors
    if deliveries.turn_s is not None:
        angles_rad = np.radians(config.task.stroke.action_limit_deg) * real
        real = real * turned_share(angles_rad, np.nan_to_num(deliveries.turn_s))[:, None]
    return strokes_from_actions(
        real,
        deliveries.racket_speeds_mps,
        config.task.stroke,
        aim_ps_m=deliveries.aim_ps_m,
        aim_t_s=deliveries.aim_t_s,
    )


def evaluation_balls(speed_mps: float, count: int, config: EnvironmentConfig) -> Deliveries:
    """The fixed balls of a speed that policies are compared on."""
    rng = np.random.default_rng([EVALUATION_SEED, round(1000 * speed_mps)])
    return deliver(speed_mps, count, config, rng)


def validation_balls(speed_mps: float, count: int, config: EnvironmentConfig) -> Deliveries:
    """The fixed balls of a speed by which one of a run's policies is chosen."""
    rng = np.random.default_rng([VALIDATION_SEED, round(1000 * speed_mps)])
    return deliver(speed_mps, count, config, rng)
