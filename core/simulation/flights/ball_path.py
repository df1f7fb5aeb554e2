"""Ball paths as event cameras follow them; the closed-form one: arcs under gravity, joined at bounces."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.jit import njit
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class BallStates:
    """The ball at N times."""

    t_s: Array
    p_world_m: Array
    """(N, 3)"""
    v_world_mps: Array
    """(N, 3)"""
    spin_radps: Array
    """(N, 3), world axes."""
    present: NDArray[np.bool_]
    """False between flights, when there is no ball; position and velocity are nan then."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibleRange:
    """Where the ball comes out of nothing and goes into nothing: N half spaces that hide it.

    A point p of the ball can be seen where `normal_world @ p > offset_m`. A flight begins and ends at such a plane
    across its direction, as at the mouth of a launcher: the ball slides out of it, so that even the first event of a
    flight comes from an intensity that changes continuously.
    """

    normal_world: Array
    """(N, 3) unit vectors."""
    offset_m: Array
    """(N,)"""


class BallPath(Protocol):
    """Where the ball is at any time: a closed form, a recorded rally, or a physics engine's samples."""

    @property
    def end_s(self) -> float:
        """When the last flight is over."""
        ...

    @property
    def discontinuities_s(self) -> Array:
        """Ascending times at which velocity jumps or the ball appears or vanishes."""
        ...

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,)."""
        ...

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """What hides the ball at the times `t_s` (N,); offset -inf where nothing does."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ParabolicPath:
    """K arcs of one ball, from `start_s[0]` to `end_s`, under gravity alone."""

    start_s: Array
    """(K,) ascending start times of the arcs."""
    p_world_m: Array
    """(K, 3) position at the start of each arc."""
    v_world_mps: Array
    """(K, 3) velocity there, after the bounce."""
    spin_radps: Array
    """(K, 3) constant along an arc."""
    end_s: float
    gravity_mps2: float = GRAVITY_MPS2

    def __post_init__(self) -> None:
        if not len(self.start_s) or (np.diff(self.start_s) <= 0).any() or self.end_s <= self.start_s[-1]:
            raise ConfigError("the arcs of a flight are out of order", expected="ascending times", got=self.start_s)

    @property
    def discontinuities_s(self) -> Array:
        """Start, bounces and end."""
        return np.append(self.start_s, self.end_s)

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,); present from the start up to, not including, the end."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        (p, v, spin), present = np.empty((3, len(t), 3)), np.empty(len(t), np.bool_)
        arcs = self.start_s, self.p_world_m, self.v_world_mps, self.spin_radps
        _on_arcs(arcs, self.end_s, self.gravity_mps2, t, (p, v, spin), present)
        return BallStates(t, p, v, spin, present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """The launcher's mouth, and its like at the end."""
        return launcher_visible_range(self, float(self.start_s[0]), np.atleast_1d(np.asarray(t_s, np.float64)))


@njit(error_model="numpy")
def _on_arcs(arcs, end_s, gravity, t_s, found, present):
    (starts_s, ps, vs, spins), (p, v, spin) = arcs, found
    for index in range(len(t_s)):
        t = t_s[index]
        present[index] = starts_s[0] <= t < end_s
        if not present[index]:
            p[index] = v[index] = spin[index] = math.nan
            continue
        arc = np.searchsorted(starts_s, t, side="right") - 1
        since = t - starts_s[arc]
        for axis in range(3):
            p[index, axis] = ps[arc, axis] + vs[arc, axis] * since
            v[index, axis], spin[index, axis] = vs[arc, axis], spins[arc, axis]
        p[index, 2] -= 0.5 * gravity * (since * since)
        v[index, 2] -= gravity * since


def launcher_visible_range(path: BallPath, start_s: float, t_s: Array) -> VisibleRange:
    """For a flight from `start_s` to `path.end_s`: the plane at its nearer end, one ball radius off the centre there.

    At the very start the whole ball is behind it; it is out after it has flown its own diameter.
    """
    normal, offset = _portals_of(path, start_s)
    nearer = (t_s - start_s > path.end_s - t_s).astype(np.intp)
    return VisibleRange(normal[nearer], offset[nearer])


@functools.lru_cache(maxsize=16)
def _portals_of(path: BallPath, start_s: float) -> tuple[Array, Array]:
    """Normals (2, 3) and offsets (2,) of the planes at the start and at the end."""
    just_before_end = np.nextafter(path.end_s, -np.inf)
    ends = path.at([start_s, just_before_end])
    direction = ends.v_world_mps / np.linalg.norm(ends.v_world_mps, axis=1, keepdims=True)
    normal = direction * [[1.0], [-1.0]]
    return normal, np.einsum("ij,ij->i", normal, ends.p_world_m) + BALL_RADIUS_M
