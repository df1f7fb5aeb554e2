"""The one-step task for many balls at once: sample serves, observe them, play strokes.

A delivery holds everything random about an episode (the serve, the target, the noise), so that playing an action is
deterministic: the same balls evaluate every policy, and a resumed run meets the same ones.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.errors import AgentError
from core.learning.config import CHOSEN_MPS, EnvironmentConfig, GoalConfig
from core.learning.task.perception import perceive
from core.learning.task.racket_table import racket_speeds
from core.learning.task.recorded_balls import BallPart, recorded_balls, select_arrivals
from core.learning.task.timed_points import turned_share
from core.physics.episode import Arrivals, Outcomes, Serves, Strokes, strokes_from_actions
from core.simulation.episodes.closed_form import fly_serves, return_balls
from core.simulation.episodes.serve import draw_serves

Array = NDArray[np.float64]

EVALUATION_SEED = 20260404
"""Seed of the fixed balls that every policy is evaluated on; no training uses it."""
VALIDATION_SEED = 20260405
"""Seed of the balls by which a run's best policy is chosen; they differ from the evaluation's."""


@dataclass(frozen=True, slots=True, eq=False)
class ServeBatch:
    """Sampled serves with the learner's observations and all other random numbers of their episodes."""

    speed_mps: float
    serves: Serves
    arrivals: Arrivals
    seen: NDArray[np.bool_]
    """(N,) False: nothing was perceived, and the ball is missed whatever the action."""
    states: Array
    """(N, 6) p_c and v_c as perceived, with spin (N, 12)."""
    aim_ps_m: Array | None
    aim_t_s: Array | None
    racket_speeds_mps: Array
    """(N,) along +x."""
    goals_m: Array
    """(N, 2)."""
    action_errors: Array
    """(N, 3) what the actuator adds, in units of the action."""
    turn_s: Array | None = None
    """(N,) time left for the racket to turn after the decision, s; None: unlimited."""

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.intp]) -> ServeBatch:
        return ServeBatch(
            self.speed_mps,
            self.serves[which],
            select_arrivals(self.arrivals, which),
            self.seen[which],
            self.states[which],
            None if self.aim_ps_m is None else self.aim_ps_m[which],
            None if self.aim_t_s is None else self.aim_t_s[which],
            self.racket_speeds_mps[which],
            self.goals_m[which],
            self.action_errors[which],
            None if self.turn_s is None else self.turn_s[which],
        )


def draw_serve_batch(
    speed_mps: float, count: int, config: EnvironmentConfig, rng: np.random.Generator, part: BallPart = "training"
) -> ServeBatch:
    """`count` balls of one serve speed, perceived through the configured source.

    Recorded balls have speeds of their own: of them `count` of the `part`, for training as often as it takes, for
    validation and test each once, so perhaps fewer.

    Raises:
        ConfigError: if there are no serves of this speed, or no recorded balls.
        RecordingError: if recorded balls cannot be read.
    """
    if config.recorded:
        found = recorded_balls(config.recorded, part, config.task)
        known = len(found.serves)
        which = rng.integers(0, known, count) if part == "training" else rng.permutation(known)[:count]
        serves, arrivals, count = found.serves[which], select_arrivals(found.arrivals, which), len(which)
        rackets_mps = racket_speeds(arrivals, config.task)
    else:
        serves = draw_serves(speed_mps, count, config.task, rng)
        arrivals = fly_serves(serves, config.task)
        rackets_mps = np.full(count, config.task.stroke.racket_speed.at(speed_mps))
    perceived = perceive(serves, arrivals, config, rng, racket_speeds_mps=rackets_mps)
    limit_deg = config.task.stroke.action_limit_deg
    errors_deg = config.actuator_bias_deg + config.actuator_error_deg * rng.standard_normal((count, 3))
    return ServeBatch(
        speed_mps,
        serves,
        arrivals,
        perceived.seen,
        perceived.states,
        perceived.aim_ps_m,
        perceived.aim_t_s,
        rackets_mps,
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


def play(deliveries: ServeBatch, actions: Array, config: EnvironmentConfig) -> Outcomes:
    """Outcomes of actions (N, 3) in [-1, 1], one per ball; rows are independent."""
    strokes = strokes_of(deliveries, actions, config)
    if config.engine == "mujoco":
        from core.simulation.episodes.mujoco_episode import simulate_episodes_mujoco

        return simulate_episodes_mujoco(deliveries.serves, strokes, config.task, dt_s=config.step_s)
    return return_balls(deliveries.arrivals, strokes, config.task)


def check_actions(actions: NDArray[np.floating], size: int, who: str, episode: int = 0) -> Array:
    """Actions (N, size) as float64; `episode` is that of the first.

    Raises:
        AgentError: naming who gave them and the episode, if they have another shape or are not finite.
    """
    try:
        table = np.atleast_2d(np.asarray(actions, np.float64))
    except (TypeError, ValueError) as error:
        raise AgentError(f"{who} gave no action", got=repr(actions)[:80], where=f"episode {episode}") from error
    if table.ndim != 2 or table.shape[1] != size:
        got = f"shape {np.shape(actions)}"
        raise AgentError(f"{who} gave an action of another shape", expected=f"{size} numbers", got=got)
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(bad):
        raise AgentError(
            f"{who} gave an action that is no number",
            expected=f"{size} numbers from -1 to 1",
            got=[float(number) for number in table[bad[0]]],
            where=f"episode {episode + int(bad[0])}",
            remedy="look at its losses: a learning rate that is too high ends so",
        )
    return table


def action_size(config: EnvironmentConfig) -> int:
    """Parts of an action: three angles, and the racket's speed where that is chosen."""
    return 4 if config.racket == "chosen" else 3


def racket_speeds_of(actions: Array, racket_speeds_mps: Array) -> Array:
    """(N,) racket speed: from the fourth part of actions (N, 4), else from the table (N,)."""
    if actions.shape[1] == 3:
        return racket_speeds_mps
    low, high = CHOSEN_MPS
    return low + (high - low) * (np.clip(actions[:, 3], -1, 1) + 1) / 2


def strokes_of(deliveries: ServeBatch, actions: Array, config: EnvironmentConfig) -> Strokes:
    """The strokes that actions (N, 3), or (N, 4) with the racket's speed, become.

    Clipped, with the actuator's error, as far as there is time to turn.
    """
    actions = check_actions(actions, np.shape(actions)[-1], "the agent")
    real = np.clip(actions[:, :3], -1, 1) + deliveries.action_errors
    if deliveries.turn_s is not None:
        angles_rad = np.radians(config.task.stroke.action_limit_deg) * real
        real = real * turned_share(angles_rad, np.nan_to_num(deliveries.turn_s))[:, None]
    return strokes_from_actions(
        real,
        racket_speeds_of(actions, deliveries.racket_speeds_mps),
        config.task.stroke,
        aim_ps_m=deliveries.aim_ps_m,
        aim_t_s=deliveries.aim_t_s,
    )


def evaluation_balls(speed_mps: float, count: int, config: EnvironmentConfig) -> ServeBatch:
    """Fixed balls of a speed on which policies are compared; read-only."""
    return _fixed_balls(EVALUATION_SEED, speed_mps, count, config, "test")


def validation_balls(speed_mps: float, count: int, config: EnvironmentConfig) -> ServeBatch:
    """Fixed balls of a speed by which a run's best policy is chosen; read-only."""
    return _fixed_balls(VALIDATION_SEED, speed_mps, count, config, "validation")


def _fixed_balls(seed: int, speed_mps: float, count: int, config: EnvironmentConfig, part: BallPart) -> ServeBatch:
    """Fixed balls, cached for all seeds of a process: timed perception of 500 balls takes as long as training on
    them.
    """
    made = _deal if config.recorded else _deal_once  # recorded files may change
    return made(seed, speed_mps, count, config, part)


def _deal(seed: int, speed_mps: float, count: int, config: EnvironmentConfig, part: BallPart) -> ServeBatch:
    rng = np.random.default_rng([seed, round(1000 * speed_mps)])
    return draw_serve_batch(speed_mps, count, config, rng, part)


_deal_once = functools.lru_cache(maxsize=16)(_deal)
