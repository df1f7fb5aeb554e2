"""Posterior mean of a perceived state, for known perception noise.

Balls are more alike than their noisy states are. How alike is seen in the states of the balls that there were; the
noise belongs to the perception, and is told. (With a normal distribution of both, the mean of the posterior.)
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.config import EnvironmentConfig

Array = NDArray[np.float64]

FEWEST_BALLS: Final = 20
"""Fewest balls for an estimate of their spread."""
VARIED: Final = slice(1, 6)
"""Parts of the state that vary and are noisy: p_c lies in the hitting plane."""


class StatePosterior:
    """Maps perceived states to posterior means."""

    def __init__(self, perceived: Array, environment: EnvironmentConfig) -> None:
        """Fit the prior to states (N, 6) of earlier balls."""
        self._position_m, self._velocity = environment.position_noise_m, environment.velocity_noise
        self._knows_noise = environment.state_source == "truth+noise" and len(perceived) >= FEWEST_BALLS
        if self._knows_noise:
            known = perceived[:, VARIED]
            self._mean = known.mean(axis=0)
            # Balls scatter at least as much as the noise alone.
            noise = self._variances(perceived).mean(axis=0)
            scale = np.sqrt(noise + 1e-12)
            values, vectors = np.linalg.eigh(np.cov(known.T) / np.outer(scale, scale))
            self._precision = (vectors / np.maximum(values, 1.0)) @ vectors.T / np.outer(scale, scale)

    def __call__(self, perceived: Array) -> Array:
        """Posterior means (N, 6) of perceived states (N, 6)."""
        if not self._knows_noise:
            return perceived
        believed = perceived.copy()
        believed[:, VARIED] -= self._variances(perceived) * ((perceived[:, VARIED] - self._mean) @ self._precision)
        return believed

    def _variances(self, perceived: Array) -> Array:
        """(N, 5) noise variance of each part."""
        speeds = np.linalg.norm(perceived[:, 3:6], axis=1, keepdims=True)
        position_m = np.full((len(perceived), 2), self._position_m)
        return np.hstack([position_m, np.repeat(self._velocity * speeds, 3, axis=1)]) ** 2
