"""Serves that are drawn from recorded ball states instead of a distribution."""

from __future__ import annotations

from typing import Final

import numpy as np

from core.errors import ConfigError
from core.physics.episode import Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.incoming import Incoming, fly_incoming

NEAR_MPS: Final = 0.25
"""Balls whose speed differs by no more count as having the speed that is asked for."""


class RecordedServes:
    """The playable ones among recorded balls: they bounce on the robot's half and come to the hitting plane."""

    def __init__(self, balls: Serves, config: TaskConfig) -> None:
        """Keep what is playable in the physics of `config`.

        Raises:
            ConfigError: if nothing is.
        """
        playable = balls[fly_incoming(balls, config).incoming == Incoming.PLAYABLE]
        if not len(playable):
            raise ConfigError("none of the balls is playable", got=f"{len(balls)} ball states")
        speeds_mps = np.linalg.norm(playable.vs_mps, axis=1)
        order = np.argsort(speeds_mps, kind="stable")
        self.balls = playable[order]
        """Serves ordered by ascending speed."""
        self._speeds_mps = speeds_mps[order]

    def draw(self, speed_mps: float, rng: np.random.Generator) -> Serves:
        """One of the balls with this speed at the recorded state, at random; the nearest one if there is none."""
        first = int(np.searchsorted(self._speeds_mps, speed_mps - NEAR_MPS))
        last = int(np.searchsorted(self._speeds_mps, speed_mps + NEAR_MPS, side="right"))
        nearest = int(np.abs(self._speeds_mps - speed_mps).argmin())
        which = int(rng.integers(first, last)) if first < last else nearest
        return self.balls[which : which + 1]
