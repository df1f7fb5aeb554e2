"""A series of serves on one clock: the path that simulated recordings follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.physics.config import PhysicsConfig
from core.simulation.flights.ball_path import BallPath, BallStates, VisibleRange
from core.simulation.flights.serve import LaunchConfig, draw_serve

Array = NDArray[np.float64]

FIRST_SERVE_S = 0.05
"""Quiet before the first ball."""
PAUSE_S = 0.08
"""Quiet between one flight's end and the next serve."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightSeries:
    """Flights one after the other, never two at once."""

    flights: tuple[BallPath, ...]
    """Each begins at its first kink."""
    discontinuities_s: Array = field(init=False)
    """Starts, bounces and ends of all flights."""
    _starts_s: Array = field(init=False)
    _ends_s: Array = field(init=False)

    def __post_init__(self) -> None:
        discontinuities_s = [flight.discontinuities_s for flight in self.flights]
        starts_s = np.array([times_s[0] for times_s in discontinuities_s])
        ends_s = np.array([flight.end_s for flight in self.flights])
        if (starts_s[1:] < ends_s[:-1]).any():
            first = int(np.argmax(starts_s[1:] < ends_s[:-1]))
            raise ConfigError("two flights overlap", got=f"{starts_s[first + 1]} s before {ends_s[first]} s")
        object.__setattr__(self, "discontinuities_s", np.concatenate([np.empty(0), *discontinuities_s]))
        object.__setattr__(self, "_starts_s", starts_s)
        object.__setattr__(self, "_ends_s", ends_s)

    @property
    def end_s(self) -> float:
        """End of the last flight; 0 without any."""
        return self.flights[-1].end_s if self.flights else 0.0

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        touching = self._touching(t)
        if len(touching) == 1:
            return self.flights[touching[0]].at(t)
        p, v, spin = np.full((3, len(t), 3), np.nan)
        present = np.zeros(len(t), np.bool_)
        for which in touching:
            states = self.flights[which].at(t)
            inside = states.present
            p[inside], v[inside] = states.p_world_m[inside], states.v_world_mps[inside]
            spin[inside] = states.spin_radps[inside]
            present |= inside
        return BallStates(t, p, v, spin, present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """What hides the ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        normal, offset = np.zeros((len(t), 3)), np.full(len(t), -np.inf)
        for which in self._touching(t):
            inside = (self._starts_s[which] <= t) & (t < self._ends_s[which])
            visible_range = self.flights[which].visible_range(t[inside])
            if inside.all():
                return visible_range
            normal[inside], offset[inside] = visible_range.normal_world, visible_range.offset_m
        return VisibleRange(normal, offset)

    def _touching(self, t: Array) -> range:
        """Numbers of the few flights that a stretch of time meets: to ask each would take long in a long recording."""
        if not len(t):
            return range(0)
        first = int(np.searchsorted(self._ends_s, t.min(), side="right"))
        return range(first, int(np.searchsorted(self._starts_s, t.max(), side="right")))


def draw_serve_series(
    configs: Sequence[LaunchConfig], rng: np.random.Generator, physics: PhysicsConfig | None = None
) -> FlightSeries:
    """One serve per config, with short pauses between; in the paper's physics unless told otherwise.

    Raises:
        ConfigError: if a config allows no serve.
    """
    flights: list[BallPath] = []
    start_s = FIRST_SERVE_S
    for config in configs:
        flights.append(draw_serve(config, start_s, rng, physics))
        start_s = flights[-1].end_s + PAUSE_S
    return FlightSeries(tuple(flights))
