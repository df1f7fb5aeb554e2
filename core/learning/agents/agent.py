"""Interface of an agent for the training loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.policy import Policy
from core.learning.agents.replay import ReplayBuffer
from core.learning.task.reward import Weights

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Losses:
    """Losses of the last update after an episode; NaN before the first."""

    critic: float
    actor: float


@dataclass(frozen=True, slots=True)
class StageProgress:
    """Progress of a stage at a learning step."""

    episode: int
    """Number of the episode in this stage, from 0."""
    share: float
    """Share of the stage that is done, 0..1."""
    weights: Weights
    """Current weights of the reward."""


class Agent(Protocol):
    """Networks with their optimisers; buffer, noise and curriculum belong to the loop."""

    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """Actions (N, 3) in [-1, 1] without noise."""
        ...

    def learn(self, buffer: ReplayBuffer, progress: StageProgress, rng: np.random.Generator) -> Losses:
        """Learn from the buffer after a ball."""
        ...

    def policy(self) -> Policy:
        """Copy of the current policy."""
        ...

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Complete state, from which `restore` continues bit-exactly."""
        ...

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restore the state from `arrays`."""
        ...
