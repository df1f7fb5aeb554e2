"""Many copies of the one-step task at once, played in one batch: `gymnasium.make_vec("Rallyscope/Return-v0", 64)`."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from core.errors import AgentError, ConfigError
from core.learning.config import EnvironmentConfig, RacketSpeedRule, RewardConfig
from core.learning.gym_environment import infos_of, observations_of, rewards_in, spaces_of, task_of
from core.learning.task.environment import ClosedFormBackend, ServeBatch, check_actions, draw_serve_batch, play
from core.physics.task import HitRule

Floats = NDArray[np.float32]

BATCH = 8192
"""Balls drawn at a time, for all copies ..."""
FEW = 256
"""... and where the hit is chosen."""


class VectorReturn(gymnasium.vector.VectorEnv[Floats, Floats, NDArray[Any]]):
    """Observations (N, 8), with spin (N, 14); actions (N, 3), with a chosen racket (N, 4), in [-1, 1].

    Every step ends every episode, and gives the next ball's observation at once (`SAME_STEP`); those of the balls that
    were played are in `infos["final_obs"]`. What came of the strokes is in `infos`, and in `infos["final_info"]`.
    """

    agent = "the agent"
    """Who acts, in messages."""

    def __init__(
        self,
        num_envs: int = 1,
        speed_mps: float = 5.0,
        environment: EnvironmentConfig | None = None,
        reward: RewardConfig | str | None = None,
        racket: RacketSpeedRule | None = None,
        hit: HitRule | None = None,
    ) -> None:
        """Raises ConfigError for a number of copies below 1, or states from events, which need event cameras.

        Args:
            num_envs: number of copies.
            speed_mps: of the serves at the launcher.
            environment: the task; None: the paper's.
            reward: its config or name; None: the paper's.
            racket: speed of the racket; None: the environment's.
            hit: where balls are met; None: as the environment says.
        """
        if num_envs < 1:
            raise ConfigError("no copies of the environment", expected="1 or more", got=num_envs, where="num_envs")
        self.environment, self.reward = task_of(environment, reward, racket, hit)
        ClosedFormBackend(self.environment)  # refuses what only event cameras have
        self.speed_mps = speed_mps
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces_of(self.environment)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}
        self.render_mode = None
        self.episodes = 0
        """Ended so far in each copy; the time-weighted reward counts them."""
        self._drawn: ServeBatch | None = None
        self._seen = np.zeros((0, 0), np.float32)
        self._next = 0
        self._now: ServeBatch | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Serve a ball to each copy; equal seeds give equal balls.

        Raises:
            ConfigError: for a seed per copy: all draw from one generator.
        """
        if seed is not None and not isinstance(seed, int | np.integer):
            raise ConfigError("not a seed", expected="one whole number for all copies", got=repr(seed)[:80])
        super().reset(seed=None if seed is None else int(seed))
        if seed is not None:
            self._drawn = None
        return self._draw_batch(), {}

    def step(
        self, actions: Floats
    ) -> tuple[Floats, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Play all strokes.

        Raises:
            ResetNeeded: before the first `reset`.
            AgentError: if an action or a reward is no number, or the actions have another shape.
        """
        now = self._now
        if now is None:
            raise ResetNeeded("step before the first reset; call reset first")
        if np.shape(actions) != self.action_space.shape:
            expected, got = self.action_space.shape, np.shape(actions)
            raise AgentError(f"{self.agent} gave actions of another shape", expected=expected, got=got)
        wanted = self._checked(actions)
        outcome = play(now, wanted, self.environment)
        rewards = rewards_in(outcome, now, self.episodes, self.reward)
        self.episodes += 1
        infos: dict[str, Any] = {**infos_of(outcome, now)}
        everywhere = np.ones(self.num_envs, np.bool_)
        infos |= {f"_{key}": everywhere for key in tuple(infos)}
        final = self._seen[self._next - self.num_envs : self._next].copy()
        infos |= {"final_info": dict(infos), "_final_info": everywhere, "final_obs": final, "_final_obs": everywhere}
        return self._draw_batch(), rewards, everywhere.copy(), np.zeros(self.num_envs, np.bool_), infos

    def _checked(self, actions: Floats) -> NDArray[np.float64]:
        (size,) = self.single_action_space.shape or (3,)
        if not np.isfinite(actions).all():
            copy = int(np.flatnonzero(~np.isfinite(actions).all(axis=1))[0])
            check_actions(actions[copy], size, f"{self.agent} in copy {copy}", self.episodes)
        return np.asarray(actions, np.float64)

    def _draw_batch(self) -> Floats:
        """The next ball of each copy, and what is seen of them."""
        if self._drawn is None or self._next + self.num_envs > len(self._drawn):
            # The place of each ball is chosen one by one, which takes a millisecond.
            rounds = max(1, (BATCH if self.environment.hit == "paper" else FEW) // self.num_envs)
            count = rounds * self.num_envs
            self._drawn = draw_serve_batch(self.speed_mps, count, self.environment, self.np_random)
            self._seen = observations_of(self._drawn)
            self._next = 0
        which = slice(self._next, self._next + self.num_envs)
        self._now = self._drawn[which]
        self._next += self.num_envs
        # An agent may write into its observation.
        return self._seen[which].copy()
