"""Where balls are served and seen: what a perception needs of a hall, and nothing more."""

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
    """What the cameras saw in [start_us, end_us): no ball, no contact, no outcome."""

    start_us: int
    end_us: int
    events: dict[str, Events]
    """Events by camera."""


class EnvironmentBackend(Protocol):
    """A table with event cameras, a ball machine and a racket. One thread."""

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Calibrated, by name."""
        ...

    @property
    def now_us(self) -> int:
        """End of the newest block, on the cameras' clock."""
        ...

    def begin(self, seed: int) -> None:
        """Start anew, if that is possible here; else go on."""
        ...

    def serve(self, p_m: Array, v_mps: Array, spin_radps: Array) -> None:
        """Tell the ball machine what to serve now. When and how fast it does is for the cameras to see."""
        ...

    def aim(self, target: RacketTarget | None) -> None:
        """Send the racket to a target, in seconds of the cameras' clock, or to rest.

        Raises:
            ConfigError: if it cannot go there.
        """
        ...

    def advance(self) -> SeenBlock:
        """What is seen next."""
        ...

    def close(self) -> None:
        """Give back threads and connections."""
        ...
