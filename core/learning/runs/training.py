"""One seed of a run: the curriculum of speeds, episode by episode, with everything that a checkpoint must hold.

Read it with `ddpg.py` (the networks) and `reward.py`: together they are the paper's method.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.agents.agent import Agent, Losses, StageProgress
from core.learning.agents.ddpg import DdpgAgent
from core.learning.agents.landing_model import LandingModelAgent
from core.learning.agents.policy import Policy
from core.learning.agents.process_agent import ProcessAgent
from core.learning.agents.reflection_agent import ReflectionAgent
from core.learning.agents.replay import ReplayBuffer, ReplayStart, start_stage
from core.learning.config import RunConfig
from core.learning.evaluation.policy_evaluator import episode_line, transition_of
from core.learning.registered_agents import AGENTS, MakeAgent
from core.learning.runs.run_files import pack_arrays, restore_arrays
from core.learning.task.environment import (
    ClosedFormBackend,
    EpisodeBackend,
    ServeBatch,
    action_size,
    check_actions,
    draw_serve_batch,
)
from core.learning.task.reward import episode_rewards, reward_weights
from core.physics.episode import Case

BALLS, CHOICES = 0, 1
"""Random streams of a seed: one for the balls, one for the learner."""


class Training:
    """A seed of a run, always between two episodes."""

    def __init__(self, config: RunConfig, seed: int, backend: EpisodeBackend | None = None) -> None:
        self.config = config
        self.seed = seed
        self._backend = backend or ClosedFormBackend(config.environment)
        self._backend.begin(seed)
        self._rng = np.random.default_rng([seed, CHOICES])
        self._agent = make_agent(config, self._rng)
        self._action_size = action_size(config.environment)
        self._buffer = ReplayBuffer(config.episodes, config.environment.state, self._action_size)
        self.episode = 0
        """Episodes done in all stages."""
        self._stage = 0
        self._stage_episode = 0
        self._recent = np.zeros(config.curriculum.converged_window, np.bool_)
        self._kept: ReplayStart | None = None
        self._batch = self._draw_batch()

    @property
    def finished(self) -> bool:
        """Whether the last stage is over."""
        return self._stage == len(self.config.curriculum.speeds_mps)

    @property
    def share(self) -> float:
        """Share of the run that is done, an upper bound: stages that converge early shorten it."""
        curriculum = self.config.curriculum
        return (sum(curriculum.episodes[: self._stage]) + self._stage_episode) / self.config.episodes

    @property
    def speed_mps(self) -> float:
        """Serve speed of this stage; of the last one at the end."""
        speeds = self.config.curriculum.speeds_mps
        return speeds[min(self._stage, len(speeds) - 1)]

    @property
    def policy(self) -> Policy:
        """Current policy."""
        return self._agent.policy()

    def play_episode(self) -> dict[str, object]:
        """One serve, one action, one outcome, and what is learned from it; returns its line for the metrics."""
        n, stage = self._stage_episode, self._stage
        exploration, curriculum = self.config.exploration, self.config.curriculum
        noise = exploration.noise_at(n)
        is_random = self.episode < exploration.random_episodes
        batch = self._backend.observe(self._batch[n : n + 1])
        action = self._exploratory_action(batch, noise, is_random)
        check_actions(action, self._action_size, f"the agent {self.config.agent}, seed {self.seed},", self.episode)
        outcome = self._backend.play(batch, action)
        weights = reward_weights(n, self.config.reward)
        where = f"episode {self.episode}, seed {self.seed}"
        reward = float(episode_rewards(outcome, batch.goals_m, weights, self.config.reward, where=where)[0])
        losses = Losses(float("nan"), float("nan"))
        # A ball that perception missed has no state to learn from.
        if batch.seen[0]:
            self._buffer.add(transition_of(batch, action[0], outcome, reward))
        if len(self._buffer):
            progress = StageProgress(n, n / curriculum.episodes[stage], weights)
            losses = self._agent.learn(self._buffer, progress, self._rng)
        line = episode_line(
            episode=self.episode,
            stage=stage,
            stage_episode=n,
            batch=batch,
            action=action[0],
            noise=noise,
            is_random=is_random,
            outcome=outcome,
            reward=reward,
            weights=weights,
            buffer=len(self._buffer),
            kept=self._kept if n == 0 else None,
            losses=losses,
        )
        self._recent[n % len(self._recent)] = outcome.case[0] == Case.RETURNED
        self.episode += 1
        self._stage_episode += 1
        if self._stage_is_over():
            self._next_stage()
        return line

    def _exploratory_action(self, batch: ServeBatch, noise: float, is_random: bool) -> NDArray[np.float64]:
        """The policy's action with noise, or a random one; both are always drawn, so that options can be compared."""
        size = (1, self._action_size)
        uniform, normal = self._rng.uniform(-1, 1, size), self._rng.standard_normal(size)
        if is_random:
            return uniform
        action = self._agent.act(batch.states, batch.racket_speeds_mps, batch.goals_m)
        return np.clip(action + noise * normal, -1, 1)

    def _stage_is_over(self) -> bool:
        curriculum = self.config.curriculum
        if self._stage_episode == curriculum.episodes[self._stage]:
            return True
        enough = self._stage_episode >= len(self._recent)
        return curriculum.advance == "converged" and enough and bool(self._recent.mean() >= curriculum.converged_rate)

    def _next_stage(self) -> None:
        self._stage += 1
        self._stage_episode = 0
        self._recent[:] = False
        if not self.finished:
            self._kept = start_stage(self._buffer, self.config.curriculum)
            self._batch = self._draw_batch()

    def _draw_batch(self) -> ServeBatch:
        """Draw all balls of this stage, the same for every agent with this seed."""
        curriculum = self.config.curriculum
        rng = np.random.default_rng([self.seed, BALLS, self._stage])
        return draw_serve_batch(
            curriculum.speeds_mps[self._stage], curriculum.episodes[self._stage], self.config.environment, rng
        )

    def to_checkpoint(self) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
        """Arrays and plain values from which training continues bit-exactly."""
        arrays = pack_arrays(self._agent, self._buffer)
        arrays["recent"] = self._recent.copy()
        about: dict[str, object] = {
            "seed": self.seed,
            "episode": self.episode,
            "stage": self._stage,
            "stage_episode": self._stage_episode,
            "kept": None if self._kept is None else [self._kept.kept, self._kept.dropped],
            "random": self._rng.bit_generator.state,
        }
        if self._kept is not None and self._kept.cases:
            about["kept_cases"] = [list(row) for row in self._kept.cases]
        if self.config.environment.state != "plain":
            about["state"] = self.config.environment.state
        return arrays, about

    @classmethod
    def from_checkpoint(
        cls,
        config: RunConfig,
        seed: int,
        arrays: dict[str, NDArray[np.generic]],
        about: dict[str, object],
        backend: EpisodeBackend | None = None,
    ) -> Training:
        """The training that gave the checkpoint.

        Raises:
            ConfigError: if it is another run's.
        """
        training = cls(config, seed, backend)
        try:
            training._restore(arrays, about)
        except (KeyError, ValueError, TypeError, RuntimeError) as error:
            raise ConfigError("a checkpoint of another run", got=str(error), where=f"seed {seed}") from error
        return training

    def _restore(self, arrays: dict[str, NDArray[np.generic]], about: dict[str, object]) -> None:
        if about["seed"] != self.seed:
            raise ValueError(f"seed {about['seed']}")
        trained, wanted = about.get("state", "plain"), self.config.environment.state
        if trained != wanted:
            raise ValueError(f"it was trained on states of the kind {trained}, the run has {wanted}")
        restore_arrays(arrays, self._agent, self._buffer)
        self._recent[:] = arrays["recent"]
        self.episode = int(about["episode"])  # type: ignore[call-overload]
        self._stage = int(about["stage"])  # type: ignore[call-overload]
        self._stage_episode = int(about["stage_episode"])  # type: ignore[call-overload]
        kept = about["kept"]
        cases = tuple((int(case), int(k), int(d)) for case, k, d in about.get("kept_cases", ()))  # type: ignore[union-attr]
        self._kept = None if kept is None else ReplayStart(*kept, cases)  # type: ignore[misc]
        self._rng.bit_generator.state = about["random"]  # type: ignore[assignment]
        if not self.finished and self._stage > 0:
            self._batch = self._draw_batch()


def _make_landing_model(config: RunConfig, rng: np.random.Generator) -> Agent:
    heads: dict[str, MakeAgent] = {"process": ProcessAgent, "reflection": ReflectionAgent}
    return heads.get(config.landing_model.head, LandingModelAgent)(config, rng)


OURS: Final[dict[str, MakeAgent]] = {"ddpg": DdpgAgent, "landing-model": _make_landing_model}


def make_agent(config: RunConfig, rng: np.random.Generator) -> Agent:
    """A new agent by the config's name.

    Raises:
        ConfigError: if it is one of stable-baselines3, which trains itself.
    """
    make = AGENTS[config.agent].make or OURS.get(config.agent)
    if make is None:
        others = ", ".join(name for name, agent in AGENTS.items() if not agent.trains_itself)
        raise ConfigError("an agent that trains itself", expected=others, got=config.agent)
    return make(config, rng)
