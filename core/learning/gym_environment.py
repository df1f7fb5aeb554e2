"""The one-step task as a Gymnasium environment, `Rallyscope/Return-v0`, for agents that others wrote.

To import this module registers it, as does `gymnasium.make("core.learning.gym_environment:Rallyscope/Return-v0")`.
"""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from core.errors import AgentError
from core.learning.config import EnvironmentConfig, RacketSpeedRule, RewardConfig
from core.learning.evaluation.policy_evaluator import landing_errors_mm
from core.learning.task.environment import (
    ClosedFormBackend,
    EpisodeBackend,
    ServeBatch,
    action_size,
    check_actions,
    draw_serve_batch,
)
from core.learning.task.normalise import STATE_SIZES, normal_observations
from core.learning.task.reward import episode_rewards, reward_weights
from core.physics.episode import Case, Outcomes
from core.physics.task import HitRule

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

RETURN_ID = "Rallyscope/Return-v0"
ENVIRONMENT_ID = "rallyscope/OneStepReturn-v0"
"""Its earlier name, which stays."""
WIDEST = 10.0
"""Bound of an observation; `normal_states` clips there."""
BATCH = 256
"""Balls drawn at a time."""


class OneStepReturn(gymnasium.Env[Floats, Floats]):
    """Observation (8,), with spin (14,): state and target normalised; action (3,) in [-1, 1]; one step, one episode.

    Where the racket's speed is chosen, the action has it as a fourth number.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own declaration
    agent = "the agent"
    """Who acts, in messages."""

    def __init__(
        self,
        speed_mps: float = 5.0,
        environment: EnvironmentConfig | None = None,
        reward: RewardConfig | str | None = None,
        batch: ServeBatch | None = None,
        backend: EpisodeBackend | None = None,
        racket: RacketSpeedRule | None = None,
        hit: HitRule | None = None,
    ) -> None:
        """An environment before its first episode.

        Args:
            speed_mps: of the serves at the launcher.
            environment: the task; None: the paper's.
            reward: its config or name; None: the paper's.
            batch: exactly these balls are played, in this order, again from the first after the last.
            backend: what serves and plays them; None: the closed-form simulator.
            racket: speed of the racket; None: the environment's.
            hit: where balls are met; None: as the environment says.
        """
        self.environment, self.reward = task_of(environment, reward, racket, hit)
        self.speed_mps = speed_mps
        self.observation_space, self.action_space = spaces_of(self.environment)
        self.episodes = 0
        """Number of episodes so far, which the time-weighted reward depends on."""
        self.outcome: Outcomes | None = None
        """Outcome of the last episode."""
        self._backend = backend or ClosedFormBackend(self.environment)
        self._fixed = batch
        self._drawn = batch
        self._next = 0
        self._now: ServeBatch | None = None
        # `step` before the first `reset` is an error.
        self._is_over = True

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Serve the next ball and observe it."""
        super().reset(seed=seed)
        if seed is not None and self._fixed is None:
            self._drawn = None
        if seed is not None:
            self._backend.begin(seed)
        if self._drawn is None or self._next >= len(self._drawn):
            self._drawn = self._fixed or draw_serve_batch(self.speed_mps, BATCH, self.environment, self.np_random)
            self._next = 0
        self._now = self._backend.observe(self._drawn[self._next : self._next + 1])
        self._next += 1
        self._is_over = False
        return observations_of(self._now)[0], {}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Play the stroke; the next observation is the same ball's, as the episode ends.

        Raises:
            ResetNeeded: before the first `reset`, and after the end of an episode.
            AgentError: if the action or the reward is no number, or the action has another shape.
        """
        if self._now is None or self._is_over:
            when = "before the first reset" if self._now is None else "after the end: an episode is one step"
            raise ResetNeeded(f"step {when}; call reset first")
        now = self._now
        action = np.asarray(action)
        if action.ndim != 1:
            shape = self.action_space.shape
            raise AgentError(f"{self.agent} gave an action of another shape", expected=shape, got=action.shape)
        actions = check_actions(action, action_size(self.environment), self.agent, self.episodes)
        outcome = self._backend.play(now, actions)
        self.outcome = outcome
        reward = float(rewards_in(outcome, now, self.episodes, self.reward)[0])
        self.episodes += 1
        self._is_over = True
        about = infos_of(outcome, now)
        info = {"case": int(about["case"][0]), "is_returned": bool(about["is_returned"][0])}
        info |= {"error_mm": float(about["error_mm"][0]), "landing_m": about["landing_m"][0]}
        return observations_of(now)[0], reward, True, False, info

    def close(self) -> None:
        """Close the backend."""
        self._backend.close()


def task_of(
    environment: EnvironmentConfig | None,
    reward: RewardConfig | str | None,
    racket: RacketSpeedRule | None,
    hit: HitRule | None = None,
) -> tuple[EnvironmentConfig, RewardConfig]:
    """The task and the reward, with what was left out: states known exactly, the reward by cases."""
    task = environment if environment is not None else EnvironmentConfig(state_source="truth")
    task = dataclasses.replace(task, racket=racket or task.racket, hit=hit or task.hit)
    if not isinstance(reward, RewardConfig):
        reward = RewardConfig(kind="case" if reward is None else reward)
    return task, reward


def spaces_of(environment: EnvironmentConfig) -> tuple[gymnasium.Space[Floats], gymnasium.Space[Floats]]:
    """The spaces of an observation and of an action."""
    size = STATE_SIZES[environment.state] + 2
    observation = gymnasium.spaces.Box(-WIDEST, WIDEST, (size,), np.float32)
    action = gymnasium.spaces.Box(-1.0, 1.0, (action_size(environment),), np.float32)
    return cast("gymnasium.Space[Floats]", observation), cast("gymnasium.Space[Floats]", action)


def observations_of(balls: ServeBatch) -> Floats:
    """(N, 8), or (N, 14) with spin; 0 for what was not perceived."""
    return np.clip(np.nan_to_num(normal_observations(balls.states, balls.goals_m)), -WIDEST, WIDEST)


def infos_of(outcome: Outcomes, balls: ServeBatch) -> dict[str, NDArray[Any]]:
    """What came of strokes: `case` (N,) a `Case`, `is_returned` (N,), `error_mm` (N,), `landing_m` (N, 2).

    Landing and error are NaN where the racket missed the ball.
    """
    return {
        "case": outcome.case.astype(np.int64),
        "is_returned": outcome.case == Case.RETURNED,
        "error_mm": landing_errors_mm(outcome, balls.goals_m),
        "landing_m": np.array(outcome.landings_m),
    }


def rewards_in(outcome: Outcomes, balls: ServeBatch, episode: int, reward: RewardConfig) -> Array:
    """Rewards (N,) of strokes, each in its own copy's episode of this number.

    Raises:
        AgentError: naming the reward and the episode, if one is no number.
    """
    weights = reward_weights(episode, reward)
    return episode_rewards(outcome, balls.goals_m, weights, reward, where=f"episode {episode}")


def register_environment() -> str:
    """Make the environment known to `gymnasium.make` and `make_vec`, once; returns its earlier name."""
    for name in (RETURN_ID, ENVIRONMENT_ID):
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="core.learning.gym_environment:OneStepReturn",
                vector_entry_point="core.learning.vector_environment:VectorReturn",
            )
    return ENVIRONMENT_ID


register_environment()
