"""Paths of ball and racket over one block, from the rally's steps and impacts, for the event cameras."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.jit import njit
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
        p, n = np.empty((len(t), 3)), np.empty((len(t), 3))
        _racket_at(self.t_s, self.ps_m, self.vs_mps, self.normals, t, p, n)
        return RacketPoses(p, n)


@njit(error_model="numpy")
def _racket_at(t_s, ps, vs, normals, times_s, p, n):
    for index in range(len(times_s)):
        which = min(max(np.searchsorted(t_s, times_s[index], side="right") - 1, 0), len(t_s) - 2)
        h = t_s[which + 1] - t_s[which]
        s = min(max((times_s[index] - t_s[which]) / h, 0.0), 1.0)
        length2 = 0.0
        for axis in range(3):
            start, v0, v1 = ps[which, axis], vs[which, axis] * h, vs[which + 1, axis] * h
            step = ps[which + 1, axis] - start
            p[index, axis] = start + s * (v0 + s * (3 * step - 2 * v0 - v1 + s * (v0 + v1 - 2 * step)))
            # It turns by less than 3 degrees in a step.
            n[index, axis] = (1 - s) * normals[which, axis] + s * normals[which + 1, axis]
            length2 += n[index, axis] * n[index, axis]
        for axis in range(3):
            n[index, axis] /= math.sqrt(length2)


class SampledPath:
    """Cubic pieces between samples, with a jump of velocity at impacts. Exact for a parabola."""

    def __init__(self, start_s: float) -> None:
        self._starts: list[tuple[float, Array]] = []
        self._ends: list[tuple[float, Array]] = []
        self._pieces: tuple[Array, Array] | None = None
        self._discontinuities_s: list[float] = []
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
            self._pieces = None
            self.end_s = end_s

    def kink(self, t_s: float) -> None:
        """Add a discontinuity: the velocity jumps, or the ball appears or vanishes."""
        self._discontinuities_s.append(t_s)

    @property
    def discontinuities_s(self) -> Array:
        """Ascending."""
        return np.unique(np.array(self._discontinuities_s, np.float64))

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at times (N,); after the last sample it is where that says."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        if not self._starts:
            nothing = np.full((len(t), 3), np.nan)
            return BallStates(t, nothing, nothing, nothing, np.zeros(len(t), np.bool_))
        if self._pieces is None:
            sides = list(zip(self._starts, self._ends, strict=True))
            self._pieces = np.array([(a[0], b[0]) for a, b in sides]), np.array([(a[1], b[1]) for a, b in sides])
        vanished_s = math.inf if self.gone_s is None else self.gone_s + SINK_S
        (p, v, spin), present = np.empty((3, len(t), 3)), np.empty(len(t), np.bool_)
        _ball_at(*self._pieces, vanished_s, t, (p, v, spin), present)
        return BallStates(t, p, v, spin, present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
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


@njit(error_model="numpy")
def _ball_at(pieces_s, states, vanished_s, times_s, found, present):
    p, v, spin = found
    for index in range(len(times_s)):
        t = times_s[index]
        present[index] = pieces_s[0, 0] <= t < vanished_s
        if not present[index]:
            p[index] = v[index] = spin[index] = math.nan
            continue
        which = max(np.searchsorted(pieces_s[:, 0], t, side="right") - 1, 0)
        start_s, end_s = pieces_s[which]
        h = end_s - start_s
        s = min(max((t - start_s) / h, 0.0), 1.0)
        a, b = states[which]
        for axis in range(3):
            step, v0, v1 = b[axis] - a[axis], a[3 + axis] * h, b[3 + axis] * h
            square, cube = 3 * step - 2 * v0 - v1, v0 + v1 - 2 * step
            p[index, axis] = a[axis] + s * (v0 + s * (square + s * cube))
            v[index, axis] = (v0 + s * (2 * square + 3 * s * cube)) / h
            spin[index, axis] = a[6 + axis]
