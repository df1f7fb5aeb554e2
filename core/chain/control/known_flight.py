"""Flights that are known, not predicted, as the choice of the hit takes them: of a simulation, or of a training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.physics.episode import Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.incoming import Incoming, IncomingBalls, fly_incoming
from core.trajectory.prediction import HitPlane, Stage, TablePoint

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class KnownFlight:
    """The true flight of one ball from its launch, as the choice of the hit takes a prediction."""

    t_us: int
    stage: Stage
    bounces: tuple[TablePoint, ...]
    """The one on the robot's half."""
    hits: tuple[HitPlane | None, ...]
    """The ball at the planes that it was flown to; None where it is not to be hit."""

    @staticmethod
    def of(
        planes: Sequence[IncomingBalls], i: int, *, covariance: Array | None = None, launch_s: float = 0.0
    ) -> KnownFlight:
        """Ball `i` of those flown to several planes; it comes to none of them where it is not playable.

        Args:
            planes: the balls at each plane, descending x.
            i: row of the ball.
            covariance: (6, 6) how well position and velocity are to count as known; None: exactly.
            launch_s: time of the launch, from which the planes count.
        """
        hits, bounces = [], ()
        for plane in planes:
            if plane.incoming[i] != Incoming.PLAYABLE:
                hits.append(None)
                continue
            found, state, exact = plane.arrivals, plane.arrivals.states[i], np.zeros(3)
            bounces = (TablePoint(launch_s + float(found.bounce_t_s[i]), found.bounce_states[i, :3], exact),)
            known = np.zeros((6, 6)) if covariance is None else covariance
            t_s, p, v, spin = launch_s + float(found.t_s[i]), state[:3], state[3:6], state[6:]
            hits.append(HitPlane(t_s, 0.0, p, exact, v, exact, known, "pre", spin, exact))
        return KnownFlight(round(1e6 * launch_s), "pre", bounces, tuple(hits))

    def crossings(self, xs_m: ArrayLike) -> tuple[HitPlane | None, ...]:
        """The ball at the planes that it was flown to."""
        return self.hits


def fly_to_planes(balls: Serves, xs_m: ArrayLike, task: TaskConfig) -> list[IncomingBalls]:
    """The balls at each plane (K,), as `KnownFlight.of` takes them."""
    strokes = (replace(task.stroke, hit_plane_x_m=float(x_m)) for x_m in np.asarray(xs_m))
    return [fly_incoming(balls, replace(task, stroke=stroke)) for stroke in strokes]
