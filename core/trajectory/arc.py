"""Flights under gravity alone, many at once: fitted to points, evaluated, cut with planes, reflected by the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.table import BALL_RADIUS_M, GRAVITY_MPS2, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Arcs:
    """N parabolas; nan rows are flights that do not exist."""

    t_s: Array
    """(N,) reference times."""
    ps_m: Array
    """(N, 3) position then."""
    vs_mps: Array
    """(N, 3) velocity then."""

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at times (N, K) or (K,)."""
        dt = (np.broadcast_to(t_s, (len(self.t_s), t_s.shape[-1])) - self.t_s[:, None])[..., None]
        return self.ps_m[:, None] + self.vs_mps[:, None] * dt + 0.5 * GRAVITY_MPS2 * dt**2 * DOWN

    def velocities_at(self, t_s: Array) -> Array:
        """(N, 3) at times (N,)."""
        return self.vs_mps + GRAVITY_MPS2 * (t_s - self.t_s)[:, None] * DOWN


def fit_arcs(t_s: Array, ps_m: Array, observed: NDArray[np.bool_] | None = None) -> Arcs:
    """Least-squares parabolas through positions (N, K, 3) at times (N, K): two unknowns per axis, gravity known.

    Reference is the mean time, where errors of position and velocity are independent: with a point noise sigma, they
    are sigma / sqrt(K) and sigma / sqrt(sum dt^2) along each axis. Rows with fewer than two observed points are nan.
    """
    weights = np.ones(t_s.shape) if observed is None else observed.astype(np.float64)
    count = weights.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = np.where(weights > 0, t_s, 0.0).sum(axis=1) / count
        dt = np.where(weights > 0, t_s - middle[:, None], 0.0)
        # With gravity taken off all three axes are straight lines.
        straight = np.where(weights[..., None] > 0, ps_m - 0.5 * GRAVITY_MPS2 * dt[..., None] ** 2 * DOWN, 0.0)
        p = straight.sum(axis=1) / count[:, None]
        v = (dt[..., None] * straight).sum(axis=1) / (dt**2).sum(axis=1)[:, None]
    too_few = count < 2
    p[too_few], v[too_few] = np.nan, np.nan
    return Arcs(middle, p, v)


def time_down_to(arcs: Arcs, z_m: float) -> Array:
    """(N,) when each ball comes down through height z, which may have been before the reference; nan if never."""
    with np.errstate(invalid="ignore"):
        rate = np.sqrt(arcs.vs_mps[:, 2] ** 2 + 2 * GRAVITY_MPS2 * (arcs.ps_m[:, 2] - z_m))
    return arcs.t_s + (arcs.vs_mps[:, 2] + rate) / GRAVITY_MPS2


def time_back_to(arcs: Arcs, x_m: float) -> Array:
    """(N,) when each ball crosses x towards the robot; nan for balls that do not fly towards it."""
    vx = arcs.vs_mps[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(vx < 0, arcs.t_s + (x_m - arcs.ps_m[:, 0]) / vx, np.nan)


def reflect(arcs: Arcs, restitution: Array, tangential: Array) -> Arcs:
    """The arcs after the table, starting at the bounce; nan rows for balls that miss its top."""
    t = time_down_to(arcs, BALL_RADIUS_M)
    p = arcs.at(t[:, None])[:, 0]
    v = arcs.velocities_at(t) * np.column_stack([tangential, tangential, -restitution])
    with np.errstate(invalid="ignore"):
        on_table = (np.abs(p[:, 0]) <= TABLE_LENGTH_M / 2) & (np.abs(p[:, 1]) <= TABLE_WIDTH_M / 2)
    t, p[~on_table], v[~on_table] = np.where(on_table, t, np.nan), np.nan, np.nan
    return Arcs(t, p, v)
