"""Interface of an environment backend: balls are served, events come back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.events import Events
from core.simulation.episodes.racket import RacketTarget

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SeenBlock:
    """Events of the cameras in [start_us, end_us), without any truth."""

    start_us: int
    end_us: int
    events: dict[str, Events]
    """Events by camera."""


class EnvironmentBackend(Protocol):
    """A table with event cameras, a ball machine and a racket. Not thread-safe."""

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Calibrated cameras by name."""
        ...

    @property
    def now_us(self) -> int:
        """End of the newest block, on the cameras' clock."""
        ...

    def begin(self, seed: int) -> None:
        """Restart, if the backend can; else continue."""
        ...

    def serve(self, p_m: Array, v_mps: Array, spin_radps: Array) -> None:
        """Command the ball machine to serve. Time and speed of the serve are only seen by the cameras."""
        ...

    def aim(self, target: RacketTarget | None) -> None:
        """Send the racket to a target, in seconds of the cameras' clock, or to rest.

        Raises:
            ConfigError: if it cannot go there.
        """
        ...

    def advance(self) -> SeenBlock:
        """Next block of events."""
        ...

    def close(self) -> None:
        """Close threads and connections."""
        ...
