"""A court whose racket stays at rest, whatever it is told: balls come and go past."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.outcomes.environment_backend import EnvironmentBackend, SeenBlock
from core.simulation.episodes.racket import RacketTarget

Array = NDArray[np.float64]


class IdleRacketBackend:
    """Another court, but for the racket."""

    def __init__(self, world_backend: EnvironmentBackend) -> None:
        self._world_backend = world_backend

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Of the other court."""
        return self._world_backend.cameras

    @property
    def now_us(self) -> int:
        """Of the other court."""
        return self._world_backend.now_us

    def begin(self, seed: int) -> None:
        """Start the other court anew."""
        self._world_backend.begin(seed)

    def serve(self, p_m: Array, v_mps: Array, spin_radps: Array) -> None:
        """Serve there."""
        self._world_backend.serve(p_m, v_mps, spin_radps)

    def aim(self, target: RacketTarget | None) -> None:
        """Nothing moves."""

    def advance(self) -> SeenBlock:
        """What is seen there."""
        return self._world_backend.advance()

    def close(self) -> None:
        """Close it."""
        self._world_backend.close()
