"""A series of serves on one clock: the path that simulated recordings follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.simulation.flight import BallStates, Flight, Portals
from core.simulation.serve import ServeConfig, draw_serve

Array = NDArray[np.float64]

FIRST_SERVE_S = 0.05
"""Quiet before the first ball."""
PAUSE_S = 0.08
"""Quiet between one flight's end and the next serve."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightSeries:
    """Flights one after the other, never two at once."""

    flights: tuple[Flight, ...]

    def __post_init__(self) -> None:
        for before, after in zip(self.flights, self.flights[1:], strict=False):
            if after.start_s[0] < before.end_s:
                raise ConfigError("two flights overlap", got=f"{after.start_s[0]} s before {before.end_s} s")

    @property
    def end_s(self) -> float:
        """End of the last flight; 0 without any."""
        return self.flights[-1].end_s if self.flights else 0.0

    @property
    def kinks_s(self) -> Array:
        """Starts, bounces and ends of all flights."""
        return np.concatenate([flight.kinks_s for flight in self.flights]) if self.flights else np.empty(0)

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        p, v, spin = np.full((3, len(t), 3), np.nan)
        present = np.zeros(len(t), np.bool_)
        for flight in self._touching(t):
            states = flight.at(t)
            inside = states.present
            p[inside], v[inside] = states.p_world_m[inside], states.v_world_mps[inside]
            spin[inside] = states.spin_radps[inside]
            present |= inside
        return BallStates(t, p, v, spin, present)

    def portals(self, t_s: ArrayLike) -> Portals:
        """What hides the ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        normal, offset = np.zeros((len(t), 3)), np.full(len(t), -np.inf)
        for flight in self._touching(t):
            inside = (flight.start_s[0] <= t) & (t < flight.end_s)
            portals = flight.portals(t[inside])
            normal[inside], offset[inside] = portals.normal_world, portals.offset_m
        return Portals(normal, offset)

    def _touching(self, t: Array) -> list[Flight]:
        if not len(t):
            return []
        low, high = t.min(), t.max()
        return [flight for flight in self.flights if flight.start_s[0] <= high and low < flight.end_s]


def draw_serves(configs: Sequence[ServeConfig], rng: np.random.Generator) -> FlightSeries:
    """One serve per config, with short pauses between.

    Raises:
        ConfigError: if a config allows no serve.
    """
    flights: list[Flight] = []
    start_s = FIRST_SERVE_S
    for config in configs:
        flights.append(draw_serve(config, start_s, rng))
        start_s = flights[-1].end_s + PAUSE_S
    return FlightSeries(tuple(flights))
