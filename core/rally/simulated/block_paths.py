"""The paths of ball and racket over one block, from what the rally's steps and impacts say, for the event cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.simulation.flights.ball_path import BallStates, VisibleRange
from core.simulation.scenes.racket_shape import RacketPoses
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]

SINK_S: Final = 0.04
"""A ball that is out of play disappears downwards in this time: at once would be a flash of events."""
MOUTH_M: Final = 3 * BALL_RADIUS_M
"""A served ball comes out of a launcher's mouth, which hides it until it has flown this far."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledRacket:
    """Cubic pieces between samples of the racket: its path is one in a step, unless its law changes within."""

    t_s: Array
    """(M,) ascending."""
    ps_m: Array
    """(M, 3) middle of the face."""
    vs_mps: Array
    """(M, 3)."""
    normals: Array
    """(M, 3)."""
    radius_m: float
    thickness_m: float

    def at(self, t_s: ArrayLike) -> RacketPoses:
        """The racket at times (N,); beyond the samples it is where the nearest one says."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        which = np.clip(np.searchsorted(self.t_s, t, side="right") - 1, 0, len(self.t_s) - 2)
        h = (self.t_s[which + 1] - self.t_s[which])[:, None]
        s = np.clip((t - self.t_s[which])[:, None] / h, 0.0, 1.0)
        start, v0, v1 = self.ps_m[which], self.vs_mps[which] * h, self.vs_mps[which + 1] * h
        step = self.ps_m[which + 1] - start
        p = start + s * (v0 + s * (3 * step - 2 * v0 - v1 + s * (v0 + v1 - 2 * step)))
        n = (1 - s) * self.normals[which] + s * self.normals[which + 1]  # it turns by less than 3 degrees in a step
        return RacketPoses(p, n / np.linalg.norm(n, axis=1, keepdims=True))


class SampledPath:
    """Cubic pieces between samples, with a jump of velocity at impacts. Exact for a parabola."""

    def __init__(self, start_s: float) -> None:
        self._starts: list[tuple[float, Array]] = []
        self._ends: list[tuple[float, Array]] = []
        self._kinks: list[float] = []
        self._start_s = start_s
        self.end_s = start_s
        self.launch: tuple[float, Array] | None = None
        """Time and state (9,) of the serve that is being seen."""
        self.gone_s: float | None = None
        """When the ball went out of play."""

    def add(self, start_s: float, start: Array, end_s: float, end: Array) -> None:
        """The ball went from one state (9,) to another; pieces come in order."""
        if end_s > start_s:
            self._starts.append((start_s, start))
            self._ends.append((end_s, end))
            self.end_s = end_s

    def kink(self, t_s: float) -> None:
        """The velocity jumps, or the ball appears or vanishes."""
        self._kinks.append(t_s)

    @property
    def kinks_s(self) -> Array:
        """Ascending."""
        return np.unique(np.array(self._kinks, np.float64))

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at times (N,); after the last sample it is where that says."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        if not self._starts:
            nothing = np.full((len(t), 3), np.nan)
            return BallStates(t, nothing, nothing, nothing, np.zeros(len(t), np.bool_))
        t0, t1 = (np.array([time for time, _ in side]) for side in (self._starts, self._ends))
        a, b = (np.array([state for _, state in side]) for side in (self._starts, self._ends))
        which = np.clip(np.searchsorted(t0, t, side="right") - 1, 0, None)
        h = (t1 - t0)[which][:, None]
        s = np.clip((t - t0[which])[:, None] / h, 0.0, 1.0)
        a, b = a[which], b[which]
        step, v0, v1 = b[:, :3] - a[:, :3], a[:, 3:6] * h, b[:, 3:6] * h
        square, cube = 3 * step - 2 * v0 - v1, v0 + v1 - 2 * step
        p = a[:, :3] + s * (v0 + s * (square + s * cube))
        v = (v0 + s * (2 * square + 3 * s * cube)) / h
        present = t >= t0[0]
        if self.gone_s is not None:
            present &= t < self.gone_s + SINK_S
        p[~present], v[~present] = np.nan, np.nan
        return BallStates(t, p, v, np.where(present[:, None], a[:, 6:9], np.nan), present)

    def portals(self, t_s: ArrayLike) -> VisibleRange:
        """The launcher's mouth just after a serve; the rising floor of a ball that is out of play."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        normal, offset = np.zeros((len(t), 3)), np.full(len(t), -np.inf)
        if self.launch is not None:
            start_s, state = self.launch
            speed = float(np.linalg.norm(state[3:6]))
            if speed > 0:
                near = (t >= start_s) & ((t - start_s) * speed < MOUTH_M)
                normal[near] = state[3:6] / speed
                offset[near] = normal[near] @ state[:3] + BALL_RADIUS_M
        if self.gone_s is not None and self._ends:
            sinking = t >= self.gone_s
            share = (t[sinking] - self.gone_s) / SINK_S
            normal[sinking] = (0.0, 0.0, 1.0)
            offset[sinking] = self._ends[-1][1][2] + BALL_RADIUS_M * (2 * share - 1)
        return VisibleRange(normal, offset)
