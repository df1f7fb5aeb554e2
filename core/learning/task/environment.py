"""The one-step task for many balls at once: sample serves, observe them, play strokes.

A batch holds everything random about an episode (the serve, the target, the noise), so that playing an action is
deterministic: the same balls evaluate every policy, and a resumed run meets the same ones.

Backends that observe and play balls: the closed-form simulator, which needs microseconds, or something slower that
plays the same task, ball by ball: through the event cameras, or in a simulation server.

Balls of human play in place of drawn serves: `recorded_balls`.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.errors import AgentError, ConfigError
from core.learning.config import CHOSEN_MPS, EnvironmentConfig, GoalConfig, RunConfig
from core.learning.task.drawn_worlds import (
    draw_constants,
    draw_differing_serves,
    equal_rows,
    join_rows,
    select_arrivals,
    with_constants,
)
from core.learning.task.perception import misjudge, perceive
from core.learning.task.recorded_balls import BallPart, recorded_balls
from core.learning.task.timed_points import turned_share
from core.physics.episode import Arrivals, Outcomes, Serves, Strokes, strokes_from_actions
from core.physics.task import STAGE_SPEEDS_MPS, ServeConfig, TaskConfig
from core.simulation.episodes.closed_form import draw_serves, fly_serves, return_balls

Floats = NDArray[np.float32]
SAMPLE = 64
"""Serves per speed: their arrival speeds differ by 1 %."""
BALLS, CHOICES = 0, 1
"""Random streams of a seed: one for the balls, one for the learner."""


def racket_table(config: RunConfig) -> tuple[Floats, Floats]:
    """Mean speed of arrival along x, ascending, and the racket's speed, both (K,), of the run's stages.

    Recorded balls have all speeds, and so the whole table.
    """
    task = config.environment.task
    if config.environment.recorded:
        return _whole_table(task)
    return _table(task, tuple(sorted(set(config.curriculum.speeds_mps))))


def racket_speeds(arrivals: Arrivals, task: TaskConfig) -> NDArray[np.float64]:
    """(N,) racket speed for arriving balls, m/s."""
    return np.interp(-arrivals.states[:, 3], *_whole_table(task))


def _whole_table(task: TaskConfig) -> tuple[Floats, Floats]:
    return _table(dataclasses.replace(task, serve=ServeConfig()), STAGE_SPEEDS_MPS)


@functools.lru_cache(maxsize=16)
def _table(task: TaskConfig, speeds_mps: tuple[float, ...]) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(0)
    incoming = [
        -np.nanmean(fly_serves(draw_serves(speed, SAMPLE, task, rng), task).states[:, 3]) for speed in speeds_mps
    ]
    racket = [task.stroke.racket_speed.at(speed) for speed in speeds_mps]
    return np.array(incoming, np.float32), np.array(racket, np.float32)


Array = NDArray[np.float64]


class EpisodeBackend(Protocol):
    """Plays balls one at a time: `observe`, then `play` the same ball."""

    def begin(self, seed: int) -> None:
        """Restart: equal seeds then give equal observations of equal balls."""
        ...

    def observe(self, batch: ServeBatch) -> ServeBatch:
        """Serve the one ball of `batch`; returns it with the observations up to the decision."""
        ...

    def play(self, batch: ServeBatch, action: Array) -> Outcomes:
        """Outcome of the action (1, 3) on the observed ball."""
        ...

    def close(self) -> None:
        """Close threads and connections."""
        ...


class ClosedFormBackend:
    """The simulator of `environment`: a batch already contains its observations."""

    def __init__(self, config: EnvironmentConfig) -> None:
        """Raise ConfigError for a state source that needs event cameras."""
        if config.state_source == "events":
            raise ConfigError(
                "states from events need event cameras",
                where="state_source",
                remedy="train with the backend of core.live.worlds.event_environment, as `rallyscope train` does",
            )
        self._config = config

    def begin(self, seed: int) -> None:
        """Do nothing: nothing is random here."""

    def observe(self, batch: ServeBatch) -> ServeBatch:
        """Return the batch, which already contains its observations."""
        return batch

    def play(self, batch: ServeBatch, action: Array) -> Outcomes:
        """Play the balls as `environment.play` does."""
        return play(batch, action, self._config)

    def close(self) -> None:
        """Do nothing."""


def observe_all(backend: EpisodeBackend, batch: ServeBatch) -> ServeBatch:
    """Observe many balls, to be played in closed form: observations do not depend on the action."""
    observed = [backend.observe(batch[i : i + 1]) for i in range(len(batch))]
    aims = [(one.aim_ps_m, one.aim_t_s) for one in observed]
    known = [(p, t) for p, t in aims if p is not None and t is not None]
    return dataclasses.replace(
        batch,
        seen=np.concatenate([one.seen for one in observed]),
        states=np.concatenate([one.states for one in observed]),
        aim_ps_m=np.concatenate([p for p, _ in known]) if len(known) == len(observed) else None,
        aim_t_s=np.concatenate([t for _, t in known]) if len(known) == len(observed) else None,
    )


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
    constants: Array | None = None
    """(N, 5) of each ball's world, `drawn_worlds.CONSTANTS`; None: those of the task."""
    speed_errors_mps: Array | None = None
    """(N,) what an uncertain racket adds to its speed; None: nothing."""

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
            None if self.constants is None else self.constants[which],
            None if self.speed_errors_mps is None else self.speed_errors_mps[which],
        )


def draw_serve_batch(
    speed_mps: float, count: int, config: EnvironmentConfig, rng: np.random.Generator, part: BallPart = "training"
) -> ServeBatch:
    """`count` balls of one serve speed, perceived through the configured source.

    Recorded balls have speeds of their own: of them `count` of the `part`, for training as often as it takes, for
    validation and test each once, so perhaps fewer.

    Args:
        speed_mps: of the serves at the launcher.
        count: number of balls.
        config: the task.
        rng: source of random numbers.
        part: which recorded balls.

    Raises:
        ConfigError: if there are no serves of this speed, or no recorded balls.
        RecordingError: if recorded balls cannot be read.
    """
    # A stream of its own: targets, and serves where the air is the same, are those of the usual world.
    own_rng = rng.spawn(1)[0]
    constants = draw_constants(count, config.task.physics, config.randomise, own_rng)
    if config.recorded:
        found = recorded_balls(config.recorded, part, config.task)
        known = len(found.serves)
        # With repetition for training; a ball that is tested twice would count twice.
        which = rng.integers(0, known, count) if part == "training" else rng.permutation(known)[:count]
        serves, arrivals, count = found.serves[which], select_arrivals(found.arrivals, which), len(which)
        rackets_mps = racket_speeds(arrivals, config.task)
        constants = None if constants is None else constants[:count]
    else:
        serves = draw_serves(speed_mps, count, config.task, rng)  # always: what follows is then drawn as ever
        if constants is not None and config.randomise.physics:
            serves, arrivals = draw_differing_serves(speed_mps, constants, config.task, own_rng)
        else:
            arrivals = fly_serves(serves, config.task)
        rackets_mps = np.full(count, config.task.stroke.racket_speed.at(speed_mps))
    if config.hit == "chosen":
        from core.learning.task.hit_places import arrivals_where_chosen  # late: the chain loads compiled loops

        arrivals = arrivals_where_chosen(serves, arrivals, config, constants)
    perceived = perceive(serves, arrivals, config, rng, racket_speeds_mps=rackets_mps, constants=constants)
    perceived = misjudge(perceived, arrivals, config, own_rng)
    limit_deg = config.task.stroke.action_limit_deg
    errors_deg = config.actuator_bias_deg + config.actuator_error_deg * rng.standard_normal((count, 3))
    speed_errors_mps = None
    if config.racket == "uncertain":
        errors_deg += config.randomise.racket_deg * own_rng.uniform(-1, 1, (count, 3))
        speed_errors_mps = config.randomise.racket_mps * own_rng.uniform(-1, 1, count)
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
        constants,
        speed_errors_mps,
    )


def draw_goals(count: int, config: GoalConfig, rng: np.random.Generator) -> Array:
    """Targets (count, 2) in the table's plane."""
    if config.kind == "fixed":
        return np.tile(config.centre_m, (count, 1))
    low = (config.low_x_m, -config.half_width_m)
    return rng.uniform(low, (config.high_x_m, config.half_width_m), (count, 2))


def play(batch: ServeBatch, actions: Array, config: EnvironmentConfig) -> Outcomes:
    """Outcomes of actions (N, 3) in [-1, 1], one per ball, each in its own world; rows are independent."""
    if batch.constants is None or not len(batch):
        return _play_in(config.task, batch, actions, config)
    own = [(rows, with_constants(config.task, batch.constants[rows.start])) for rows in equal_rows(batch.constants)]
    return join_rows([_play_in(task, batch[rows], actions[rows], config) for rows, task in own])


def _play_in(task: TaskConfig, batch: ServeBatch, actions: Array, config: EnvironmentConfig) -> Outcomes:
    """Outcomes of actions in one world."""
    strokes = strokes_of(batch, actions, config)
    if config.engine == "mujoco":
        from core.simulation.episodes.mujoco_rally import simulate_episodes_mujoco

        if strokes.aim_ps_m is None:  # where the balls of the batch are met, not always at the task's plane
            arrivals = batch.arrivals
            strokes = dataclasses.replace(strokes, aim_ps_m=arrivals.states[:, :3], aim_t_s=arrivals.t_s)
        return simulate_episodes_mujoco(batch.serves, strokes, task, dt_s=config.step_s)
    return return_balls(batch.arrivals, strokes, task)


def check_actions(actions: NDArray[np.floating], size: int, who: str, episode: int = 0) -> Array:
    """Actions (N, size) as float64.

    Args:
        actions: (N, A) or (A,).
        size: A.
        who: what gave them, for the message.
        episode: number of the first, for the message.

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


def strokes_of(batch: ServeBatch, actions: Array, config: EnvironmentConfig) -> Strokes:
    """The strokes that actions (N, 3), or (N, 4) with the racket's speed, become.

    Clipped, with the actuator's error, as far as there is time to turn.
    """
    actions = check_actions(actions, np.shape(actions)[-1], "the agent")
    real = np.clip(actions[:, :3], -1, 1) + batch.action_errors
    if batch.turn_s is not None:
        angles_rad = np.radians(config.task.stroke.action_limit_deg) * real
        real = real * turned_share(angles_rad, np.nan_to_num(batch.turn_s))[:, None]
    speeds_mps = racket_speeds_of(actions, batch.racket_speeds_mps)
    return strokes_from_actions(
        real,
        speeds_mps if batch.speed_errors_mps is None else speeds_mps + batch.speed_errors_mps,
        config.task.stroke,
        aim_ps_m=batch.aim_ps_m,
        aim_t_s=batch.aim_t_s,
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
    made = _draw_batch if config.recorded else _draw_batch_once  # recorded files may change
    return made(seed, speed_mps, count, config, part)


def _draw_batch(seed: int, speed_mps: float, count: int, config: EnvironmentConfig, part: BallPart) -> ServeBatch:
    rng = np.random.default_rng([seed, round(1000 * speed_mps)])
    return draw_serve_batch(speed_mps, count, config, rng, part)


_draw_batch_once = functools.lru_cache(maxsize=16)(_draw_batch)
