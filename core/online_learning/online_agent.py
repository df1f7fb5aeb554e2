"""Agent and replay buffer of online learning. Loads torch only for networks."""

from __future__ import annotations

import dataclasses
from contextlib import nullcontext
from pathlib import Path
from typing import Final

import numpy as np

from core.errors import ConfigError
from core.jobs.control import one_torch_thread
from core.learning.agents.agent import Agent, StageProgress
from core.learning.agents.policy import Policy
from core.learning.agents.process_agent import ProcessAgent
from core.learning.agents.reflection_agent import ReflectionAgent
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import RunConfig
from core.learning.runs.run_files import BUFFER, pack_arrays, restore_arrays
from core.learning.task.environment import action_size
from core.learning.task.reward import reward_weights
from core.live.live_snapshot import FinishedBall
from core.online_learning.progress import transition_of_ball
from core.online_learning.start import LearningStart, save_as_run

MAX_BALLS: Final = 2000
"""Most balls in the buffer; when full, the newer half is kept."""


class OnlineAgent:
    """Agent that learns ball by ball."""

    def __init__(self, start: LearningStart, seed: int) -> None:
        """Raise ConfigError if the start's arrays do not fit its configuration."""
        self._config = config = start.config
        self._seed = seed
        self._rng = np.random.default_rng([seed, 0])
        self._agent = _make_agent(config, self._rng)
        self._actions = action_size(config.environment)
        states = start.arrays.get(f"{BUFFER}state")
        known = 0 if states is None else len(states)
        self._buffer = ReplayBuffer(max(MAX_BALLS, 2 * known), config.environment.state, self._actions)
        self._balls = 0
        self._of_stage = np.zeros(len(config.curriculum.speeds_mps), np.int64)
        self._went_on = bool(start.arrays)
        if self._went_on:
            try:
                restore_arrays(start.arrays, self._agent, self._buffer)
            except (KeyError, ValueError, TypeError, RuntimeError) as error:
                raise ConfigError("a checkpoint of another run", got=str(error), where=start.name) from error

    @property
    def policy(self) -> Policy:
        """Current policy."""
        return self._agent.policy()

    def learn(self, ball: FinishedBall) -> None:
        """Learn from a ball and the decision it was played with."""
        self._buffer.add(transition_of_ball(ball, self._config, self._actions, self._balls))
        if len(self._buffer) == self._buffer.capacity:
            self._buffer.keep(np.arange(len(self._buffer)) >= len(self._buffer) // 2)
        weights = reward_weights(self._balls, self._config.reward)
        share = min(1.0, self._balls / self._config.landing_model.full_episodes)
        with nullcontext() if isinstance(self._agent, ProcessAgent | ReflectionAgent) else one_torch_thread():
            self._agent.learn(self._buffer, StageProgress(self._balls, share, weights), self._rng)
        self._balls += 1
        speeds_mps = np.array(self._config.curriculum.speeds_mps)
        self._of_stage[np.argmin(np.abs(speeds_mps - ball.speed_mps))] += 1

    def save(self, run: Path) -> None:
        """Save as a finished run.

        Raises:
            ConfigError: if there is one of that name, or it cannot be written.
        """
        config = self._counted()
        arrays = pack_arrays(self._agent, self._buffer)
        arrays["recent"] = np.zeros(config.curriculum.converged_window, np.bool_)
        about: dict[str, object] = {
            "seed": 0,
            "episode": config.episodes,
            "stage": len(config.curriculum.speeds_mps),
            "stage_episode": 0,
            "kept": None,
            "random": self._rng.bit_generator.state,
        }
        save_as_run(run, config, self.policy, arrays, about)

    def _counted(self) -> RunConfig:
        """Config with the number of balls played, each counted in the stage nearest to its speed."""
        curriculum = self._config.curriculum
        before = np.array(curriculum.episodes) if self._went_on else 0
        episodes = tuple(np.maximum(before + self._of_stage, 1).tolist())
        return dataclasses.replace(self._config, curriculum=dataclasses.replace(curriculum, episodes=episodes))


def _make_agent(config: RunConfig, rng: np.random.Generator) -> Agent:
    if config.landing_model.head == "process":
        return ProcessAgent(config, rng)
    if config.landing_model.head == "reflection":
        return ReflectionAgent(config, rng)
    from core.learning.agents.landing_model import LandingModelAgent  # late: loads torch

    return LandingModelAgent(config, rng)
