"""An agent of your own: `rallyscope train --agent regression --plugin regression_agent.py --out RUN`.

The actions that earned most are fitted by a linear law of what was seen: reward-weighted regression (Peters and Schaal,
ICML 2007). numpy is all that it needs; the loop around it plays the balls, adds noise, stores and evaluates. It learns
from what noise found out, so give it some: `[exploration]` with `scale = 0.3` and
`random_episodes = 150` of `--config`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.learning.agents.agent import Losses, StageProgress
from core.learning.agents.policy import Policy
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import RunConfig, agent_settings
from core.learning.registered_agents import register_agent
from core.learning.task.environment import racket_table
from core.learning.task.normalise import STATE_SIZES, normal_observations

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class RegressionConfig:
    """Its settings: fields of the form in Train, the section [regression] of a run's config."""

    temperature: float = setting(0.2, 0.05, 5.0)
    """A ball that earned so much less than the best counts 0.37 of it."""
    ridge: float = setting(1.0, 0.001, 100.0)
    """What holds the law to doing nothing while there are few balls."""

    def __post_init__(self) -> None:
        check_settings(self)


class RegressionAgent:
    """action = clip(observation W + b), W (8, 3) and b (3,)."""

    def __init__(self, config: RunConfig, rng: np.random.Generator) -> None:
        self._run = config
        settings = agent_settings(config, "regression")
        assert isinstance(settings, RegressionConfig)
        self._settings = settings
        self._weight = np.zeros((STATE_SIZES[config.environment.state] + 2, 3), np.float32)
        self._bias = np.zeros(3, np.float32)

    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """Actions (N, 3) in [-1, 1] without noise."""
        return self.policy()(states, racket_speeds_mps, goals_m)

    def learn(self, buffer: ReplayBuffer, progress: StageProgress, rng: np.random.Generator) -> Losses:
        """Fit all balls so far anew; the loss is the weighted mean square of what the law leaves."""
        seen = normal_observations(buffer.column("state"), buffer.column("goal")).astype(np.float64)
        inputs, actions = np.c_[seen, np.ones(len(seen))], buffer.column("action").astype(np.float64)
        rewards = buffer.column("reward")[:, 0].astype(np.float64)
        weights = np.exp((rewards - rewards.max()) / self._settings.temperature)[:, None]
        normal = inputs.T @ (weights * inputs) + self._settings.ridge * np.eye(inputs.shape[1])
        law = np.linalg.solve(normal, inputs.T @ (weights * actions))
        self._weight, self._bias = law[:-1].astype(np.float32), law[-1].astype(np.float32)
        left = float((weights * (inputs @ law - actions) ** 2).sum() / weights.sum())
        return Losses(critic=float("nan"), actor=left)

    def policy(self) -> Policy:
        """A network of one layer: a policy's file holds numbers only, so that Watch can play it without this code."""
        incoming, racket = racket_table(self._run)
        layers = ((self._weight.copy(), self._bias.copy()),)
        return Policy(layers, "relu", "clip", False, incoming, racket, self._run.environment.state)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """All that it has learned: what a run goes on from after a stop or a kill."""
        return {"weight": self._weight, "bias": self._bias}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Load what `to_arrays` gave."""
        self._weight, self._bias = arrays["weight"].astype(np.float32), arrays["bias"].astype(np.float32)


register_agent("regression", RegressionAgent, "a linear law, fitted to what earned most", config=RegressionConfig)
