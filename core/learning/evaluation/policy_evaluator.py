"""Evaluation of a policy on fixed balls: return rate and landing error.

One line of `metrics.jsonl`: everything about an episode that a table, a plot or a replay in 3D needs.

Policies without learning (no action, random, constant landing, and an oracle) stand beside every result, because they
decide what it is worth: with an open racket doing nothing returns nearly every ball, and landing always in the middle
of the target box is 298 mm off on the average.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.agent import Losses
from core.learning.agents.policy import ActionSource
from core.learning.agents.replay import ReplayStart
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import (
    ClosedFormBackend,
    EpisodeBackend,
    ServeBatch,
    evaluation_balls,
    observe_all,
    play,
    racket_speeds_of,
    validation_balls,
)
from core.learning.task.reward import Weights
from core.physics.episode import Case, Outcomes
from core.table import TABLE_LENGTH_M

Array = NDArray[np.float64]
NET_PASSED_M = -1e-6
"""A first contact beyond this x is in or behind the net plane."""


def transition_of(
    batch: ServeBatch, action: Array, outcome: Outcomes, reward: float
) -> dict[str, NDArray[np.floating]]:
    """The replay row of one played ball (arrays of one row).

    Args:
        batch: one ball.
        action: (A,) in [-1, 1].
        outcome: of that ball.
        reward: of the episode.
    """
    missed = outcome.case[0] == Case.MISSED
    return {
        "state": batch.states[0],
        "racket_speed": batch.racket_speeds_mps,
        "goal": batch.goals_m[0],
        "action": action,
        "reward": np.array([reward]),
        # After a miss there is no landing; nothing learns from it, it only must not be NaN.
        "next_state": batch.states[0] if missed else _known_exactly(outcome.landing_states[0], batch),
        "case": np.array([float(outcome.case[0])]),
        "net_z": outcome.net_z_m,
        "known": really_seen(outcome)[0].astype(np.float64),
    }


def _known_exactly(landing: Array, batch: ServeBatch) -> Array:
    """The state (9,) of a landing as a state of the kind that the batch has, without any uncertainty."""
    size = batch.states.shape[1]
    return landing[:6] if size == 6 else np.concatenate([np.nan_to_num(landing), np.zeros(size - len(landing))])


def really_seen(outcomes: Outcomes) -> NDArray[np.bool_]:
    """(N, 2) whether the ball reached the table's plane, and the net plane, before it touched anything."""
    landed = outcomes.contact_t_s >= outcomes.landing_t_s - 1e-9
    passed = ~np.isnan(outcomes.net_z_m) & (outcomes.contact_states[:, 0] >= NET_PASSED_M)
    return np.column_stack([landed, passed])


def landing_errors_mm(outcomes: Outcomes, goals_m: Array) -> Array:
    """(N,) from the landing point in the table's plane to the target; NaN where the racket missed."""
    return 1000 * np.hypot(*(outcomes.landings_m - goals_m).T)


def episode_line(
    *,
    episode: int,
    stage: int,
    stage_episode: int,
    batch: ServeBatch,
    action: Array,
    noise: float,
    is_random: bool,
    outcome: Outcomes,
    reward: float,
    weights: Weights,
    buffer: int,
    kept: ReplayStart | None,
    losses: Losses,
) -> dict[str, object]:
    """Line about one episode; `kept` only at the start of a stage.

    Args:
        episode: number in the run.
        stage: number of the speed.
        stage_episode: number at this speed.
        batch: the one ball.
        action: (A,) in [-1, 1].
        noise: standard deviation of the exploration.
        is_random: whether the action was drawn uniformly.
        outcome: of the ball.
        reward: of the episode.
        weights: of the reward's two terms.
        buffer: transitions in the replay buffer.
        kept: what the replay buffer began the stage with; None inside of a stage.
        losses: of critic and actor.
    """
    line: dict[str, object] = {
        "episode": episode,
        "stage": stage,
        "stage_episode": stage_episode,
        "speed_mps": batch.speed_mps,
        "case": int(outcome.case[0]),
        "reward": _plain(reward),
        "error_mm": _plain(landing_errors_mm(outcome, batch.goals_m)[0]),
        "landing_m": _plains(outcome.landings_m[0]),
        "goal_m": _plains(batch.goals_m[0]),
        "net_z_m": _plain(outcome.net_z_m[0]),
        "noise": _plain(noise),
        "random": is_random,
        "w1": _plain(weights.w1),
        "w2": _plain(weights.w2),
        "buffer": buffer,
        "critic_loss": _plain(losses.critic),
        "actor_loss": _plain(losses.actor),
        "serve": _plains(batch.serves.states()[0]),
        "state": _plains(batch.states[0]),
        "action": _plains(action),
        "racket_speed_mps": _plain(racket_speeds_of(action[None], batch.racket_speeds_mps)[0]),
    }
    if batch.aim_ps_m is not None and batch.aim_t_s is not None:
        line["aim_m"], line["aim_t_s"] = _plains(batch.aim_ps_m[0]), _plain(batch.aim_t_s[0])
    if batch.constants is not None:
        line["constants"] = _plains(batch.constants[0])
    if batch.speed_errors_mps is not None:
        line["racket_errors"] = [*_plains(batch.action_errors[0]), _plain(batch.speed_errors_mps[0])]
    if kept is not None:
        line["kept"], line["dropped"] = kept.kept, kept.dropped
        if kept.cases:
            line["kept_cases"] = {str(case): [some, others] for case, some, others in kept.cases}
    return line


def _plain(value: float) -> float | None:
    """Number rounded to micrometres; None (JSON null) if unknown."""
    return round(float(value), 6) if math.isfinite(value) else None


def _plains(values: Array) -> list[float | None]:
    return [_plain(value) for value in values.tolist()]


MISSED_MM: Final = 1000 * TABLE_LENGTH_M
"""Error of a ball that the racket missed (choice): the table's length."""
BallSet = Literal["test", "validation"]
"""Ball sets: one for reported figures, one to choose a run's best policy."""


@dataclass(frozen=True, slots=True, eq=False)
class PolicyScore:
    """A policy on the fixed balls of one speed."""

    speed_mps: float
    returned: NDArray[np.bool_]
    """(N,)."""
    errors_mm: Array
    """(N,) landing extrapolated to the table's plane; NaN where the racket missed."""

    @property
    def missed(self) -> float:
        """Share of balls that the racket did not meet."""
        return float(np.isnan(self.errors_mm).mean())

    @property
    def counted_mm(self) -> Array:
        """(N,) the errors with `MISSED_MM` for balls that the racket did not meet."""
        return np.where(np.isnan(self.errors_mm), MISSED_MM, self.errors_mm)

    @property
    def return_rate(self) -> float:
        """Share of balls that are returned, 0 to 1."""
        return float(self.returned.mean())

    @property
    def error_mm(self) -> float:
        """Mean landing error over all balls, with `MISSED_MM` for missed ones."""
        return float(self.counted_mm.mean())

    @property
    def error_returned_mm(self) -> float:
        """Mean over returned balls; NaN without any."""
        return float(self.errors_mm[self.returned].mean()) if self.returned.any() else float("nan")


class PolicyEvaluator:
    """Evaluates policies on the fixed balls of an environment, which are made once."""

    def __init__(self, config: EnvironmentConfig, balls: int, backend: EpisodeBackend | None = None) -> None:
        """A backend shows the balls, once; the strokes are played in closed form, by a racket that is there in time.

        Where outcomes are those that cameras see, every stroke is played out before cameras.
        """
        self._config = config
        self._backend = backend or ClosedFormBackend(config)
        self._count = balls
        self._balls: dict[tuple[BallSet, float], ServeBatch] = {}

    def balls(self, speed_mps: float, which: BallSet = "test") -> ServeBatch:
        """The fixed balls of a speed: what figures are reported on, or as many others to choose a policy by."""
        if (which, speed_mps) not in self._balls:
            draw = evaluation_balls if which == "test" else validation_balls
            balls = draw(speed_mps, self._count, self._config)
            self._balls[which, speed_mps] = observe_all(self._backend, balls) if self._is_shown_once else balls
        return self._balls[which, speed_mps]

    @property
    def _is_shown_once(self) -> bool:
        return self._config.state_source == "events" and self._config.outcomes == "told"

    def score(self, controller: ActionSource, speed_mps: float, which: BallSet = "test") -> PolicyScore:
        """Score of a policy on the fixed balls, without noise on the action."""
        balls = self.balls(speed_mps, which)
        if self._config.outcomes == "events":
            return score_played(self._backend, controller, balls)
        return self.score_actions(controller(balls.states, balls.racket_speeds_mps, balls.goals_m), speed_mps, which)

    def score_actions(self, actions: Array, speed_mps: float, which: BallSet = "test") -> PolicyScore:
        """Score of given actions (N, 3) on the fixed balls."""
        balls = self.balls(speed_mps, which)
        outcomes = play(balls, actions, self._config)
        return PolicyScore(speed_mps, outcomes.returned, landing_errors_mm(outcomes, balls.goals_m))


def score_played(
    backend: EpisodeBackend,
    controller: ActionSource,
    balls: ServeBatch,
    progress: Callable[[float], None] = lambda share: None,
) -> PolicyScore:
    """Score of a policy on balls played one after another by the episode backend."""
    returned, errors_mm = np.zeros(len(balls), np.bool_), np.full(len(balls), np.nan)
    for i in range(len(balls)):
        ball = backend.observe(balls[i : i + 1])
        outcome = backend.play(ball, controller(ball.states, ball.racket_speeds_mps, ball.goals_m))
        returned[i], errors_mm[i] = outcome.returned[0], landing_errors_mm(outcome, ball.goals_m)[0]
        progress((i + 1) / len(balls))
    return PolicyScore(balls.speed_mps, returned, errors_mm)


COARSE, FINE, ROUNDS = 15, 7, 5
"""The oracle's grid over the two angles that matter, and how often it zooms in around the best point."""
CHOSEN_COARSE, CHOSEN_FINE, CHOSEN_ROUNDS, CHOSEN_ZOOM = (9, 5, 9), 3, 12, 0.6
"""The oracle's grid where the racket's speed is searched too: tilts, turns and speeds of the first grid, and of finer
ones, each so much narrower than the one before."""
NOT_RETURNED_MM = 1e5
"""Cost of a ball that does not come back, beside its landing error: more than any landing error."""


@dataclass(frozen=True, slots=True)
class TrivialScores:
    """Scores of trivial policies on the fixed balls of one speed."""

    zero: PolicyScore
    """The base orientation."""
    random: PolicyScore
    """Uniform random angles."""
    constant_mm: float
    """Mean distance from the middle of the target box to the targets: what hitting only the middle would score."""
    oracle: PolicyScore
    """The best angles per ball, found through the simulator itself."""


def score_trivial_policies(evaluator: PolicyEvaluator, speed_mps: float, config: EnvironmentConfig) -> TrivialScores:
    """Score every policy that needs no learning."""
    balls = evaluator.balls(speed_mps)
    rng = np.random.default_rng(0)
    return TrivialScores(
        evaluator.score_actions(np.zeros((len(balls), 3)), speed_mps),
        evaluator.score_actions(rng.uniform(-1, 1, (len(balls), 3)), speed_mps),
        float(1000 * np.hypot(*(balls.goals_m - np.array(config.goal.centre_m)).T).mean()),
        evaluator.score_actions(oracle_actions(balls, config), speed_mps),
    )


def oracle_actions(balls: ServeBatch, config: EnvironmentConfig) -> Array:
    """The best action (N, 3) per ball: a grid over pitch and yaw, then finer ones around its best point.

    Where the racket's speed is chosen that is searched too, and actions are (N, 4).

    The turn of the face about its own normal changes nothing in a rigid impact and stays zero.
    """
    if config.racket == "chosen":
        return _best_with_speed(balls, config)
    n = len(balls)
    best = np.zeros((n, 3))
    width = 1.0
    for round_ in range(1 + ROUNDS):
        side = np.linspace(-width, width, COARSE if round_ == 0 else FINE)
        offsets = np.array([(0.0, b, c) for b in side for c in side])
        tried = np.clip(best[:, None] + offsets, -1, 1)
        cost = _costs(balls, tried, config)
        best = tried[np.arange(n), cost.argmin(axis=1)]
        width *= 2 / (len(side) - 1) * 1.5
    return best


def _best_with_speed(balls: ServeBatch, config: EnvironmentConfig) -> Array:
    """(N, 4), as `oracle_actions`."""
    n = len(balls)
    best, widths = np.zeros((n, 4)), np.ones(3)
    for round_ in range(1 + CHOSEN_ROUNDS):
        counts = CHOSEN_COARSE if round_ == 0 else (CHOSEN_FINE,) * 3
        sides = [np.linspace(-width, width, count) for width, count in zip(widths, counts, strict=True)]
        offsets = np.array([(0.0, b, c, v) for b in sides[0] for c in sides[1] for v in sides[2]])
        tried = np.clip(best[:, None] + offsets, -1, 1)
        cost = _costs(balls, tried, config)
        best = tried[np.arange(n), cost.argmin(axis=1)]
        widths *= 2 / (np.array(counts) - 1) if round_ == 0 else CHOSEN_ZOOM
    return best


def _costs(balls: ServeBatch, actions: Array, config: EnvironmentConfig) -> Array:
    """(N, K) of actions (N, K, 3 or 4): the landing error, and much for a ball that does not come back."""
    n, k = actions.shape[:2]
    repeated = balls[np.repeat(np.arange(n), k)]
    outcomes = play(repeated, actions.reshape(n * k, -1), config)
    cost = np.nan_to_num(landing_errors_mm(outcomes, repeated.goals_m), nan=NOT_RETURNED_MM)
    return np.where(outcomes.returned, cost, cost + NOT_RETURNED_MM).reshape(n, k)
