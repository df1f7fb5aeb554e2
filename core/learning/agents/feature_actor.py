"""An actor without gradients: one layer of fixed random features, of which angles are linear.

What is learned are the outputs, by whoever owns it. It is a policy as any other, and needs no torch.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.policy import Policy
from core.learning.config import RunConfig
from core.learning.task.normalise import normal_observations
from core.learning.task.racket_table import racket_table

Array = NDArray[np.float64]

FEATURES: Final = 256


class FeatureActor:
    """mu(s, v_racket, g) from features tanh(W o + b); `outputs` (FEATURES + 1, 3) are zero at first."""

    def __init__(self, scale: float, rng: np.random.Generator) -> None:
        """Weights of the features have this standard deviation."""
        self._weights = rng.normal(0.0, scale, (9, FEATURES))
        self._biases = rng.normal(0.0, 1.0, FEATURES)
        self.outputs: Array = np.zeros((FEATURES + 1, 3))

    def features(self, states: Array, speeds_mps: Array, goals_m: Array) -> Array:
        """(N, FEATURES + 1) of states (N, 6), racket speeds (N,) and goals (N, 2); the last one is 1."""
        observations = normal_observations(states, goals_m, speeds_mps).astype(np.float64)
        return np.column_stack([np.tanh(observations @ self._weights + self._biases), np.ones(len(states))])

    def act(self, states: Array, speeds_mps: Array, goals_m: Array) -> Array:
        """(N, 3) actions, within the racket's range."""
        return np.clip(self.features(states, speeds_mps, goals_m) @ self.outputs, -1.0, 1.0)

    def policy(self, run: RunConfig) -> Policy:
        """The actor as a policy for a run's policy file."""
        incoming, racket = racket_table(run)
        hidden = self._weights.astype(np.float32), self._biases.astype(np.float32)
        output = self.outputs[:-1].astype(np.float32), self.outputs[-1].astype(np.float32)
        return Policy((hidden, output), "tanh", "clip", True, incoming, racket)

    def to_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Complete state, for a checkpoint."""
        return {"weights": self._weights, "biases": self._biases, "outputs": self.outputs}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Load what `to_arrays` gave.

        Raises:
            KeyError, ValueError: if they are another agent's.
        """
        for name, now in self.to_arrays().items():
            now[...] = arrays[name]
