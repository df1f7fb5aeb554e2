"""A flight through air, which has no closed form, as a path that event cameras follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.simulation.episodes.episode_path import Trajectory
from core.simulation.flights.ball_path import BallStates, VisibleRange, launcher_portals

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TracedFlight:
    """One ball on an integrated trajectory, from `start_s` to `end_s`; as smooth and exact as its integrator."""

    trajectory: Trajectory
    """Its time counts from the launch."""
    start_s: float
    end_s: float

    @property
    def kinks_s(self) -> Array:
        """Start, bounces and end."""
        times_s = np.array([self.start_s + event.t_s for event in self.trajectory.events])
        return np.append(times_s[times_s < self.end_s], self.end_s)

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,); present from the start up to, not including, the end."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        states = self.trajectory.at(t - self.start_s)
        present = (self.start_s <= t) & (t < self.end_s)
        states[~present] = np.nan
        return BallStates(t, states[:, :3], states[:, 3:6], states[:, 6:9], present)

    def portals(self, t_s: ArrayLike) -> VisibleRange:
        """The launcher's mouth, and its like at the end."""
        return launcher_portals(self, self.start_s, np.atleast_1d(np.asarray(t_s, np.float64)))
