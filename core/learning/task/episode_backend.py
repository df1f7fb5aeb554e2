"""Backends that observe and play balls: the closed-form simulator, which needs microseconds, or something slower
that plays the same task, ball by ball: through the event cameras, or in a simulation server.
"""

from __future__ import annotations

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import ServeBatch, play
from core.physics.episode import Outcomes

Array = NDArray[np.float64]


class EpisodeBackend(Protocol):
    """Plays balls one at a time: `observe`, then `play` the same ball."""

    def begin(self, seed: int) -> None:
        """Restart: equal seeds then give equal observations of equal balls."""
        ...

    def observe(self, delivery: ServeBatch) -> ServeBatch:
        """Serve the one ball of `delivery`; returns it with the observations up to the decision."""
        ...

    def play(self, delivery: ServeBatch, action: Array) -> Outcomes:
        """Outcome of the action (1, 3) on the observed ball."""
        ...

    def close(self) -> None:
        """Close threads and connections."""
        ...


class ClosedFormBackend:
    """The simulator of `environment`: a batch already contains its observations."""

    def __init__(self, config: EnvironmentConfig) -> None:
        """Raise ConfigError for a state source that needs event cameras."""
        if config.state_source == "events":
            raise ConfigError(
                "states from events need event cameras",
                where="state_source",
                remedy="give the training the court of core.live.worlds.event_environment, as `rallyscope train` does",
            )
        self._config = config

    def begin(self, seed: int) -> None:
        """Do nothing: nothing is random here."""

    def observe(self, delivery: ServeBatch) -> ServeBatch:
        """Return the batch, which already contains its observations."""
        return delivery

    def play(self, delivery: ServeBatch, action: Array) -> Outcomes:
        """Play the balls as `environment.play` does."""
        return play(delivery, action, self._config)

    def close(self) -> None:
        """Do nothing."""


def observe_all(backend: EpisodeBackend, deliveries: ServeBatch) -> ServeBatch:
    """Observe many balls, to be played in closed form: observations do not depend on the action."""
    met = [backend.observe(deliveries[i : i + 1]) for i in range(len(deliveries))]
    aims = [(one.aim_ps_m, one.aim_t_s) for one in met]
    known = [(p, t) for p, t in aims if p is not None and t is not None]
    return dataclasses.replace(
        deliveries,
        seen=np.concatenate([one.seen for one in met]),
        states=np.concatenate([one.states for one in met]),
        aim_ps_m=np.concatenate([p for p, _ in known]) if len(known) == len(met) else None,
        aim_t_s=np.concatenate([t for _, t in known]) if len(known) == len(met) else None,
    )
