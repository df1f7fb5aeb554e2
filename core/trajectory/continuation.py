"""A fitted flight continued to the table, off it, and to the hitting plane: many flights at once.

Flights are under gravity alone: fitted to points, evaluated, cut with planes, reflected by the table.
"""

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


def time_back_to(arcs: Arcs, x_m: float | Array) -> Array:
    """(N,) when each ball crosses x, one or (N,), towards the robot; nan for balls that do not fly towards it."""
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


MAX_BOUNCES = 2
"""With the second bounce the point is over."""


@dataclass(frozen=True, slots=True, eq=False)
class Continuation:
    """N flights as arcs one after the other."""

    arcs: tuple[Arcs, ...]
    """The fitted one, and one after each bounce; rows are nan where there is none."""

    def bounces(self) -> tuple[tuple[Array, Array], ...]:
        """Times (N,) and positions (N, 3) of each bounce on the table; nan where there is none."""
        return tuple((arcs.t_s, arcs.ps_m) for arcs in self.arcs[1:])

    def landing(self, after_s: float) -> tuple[Array, Array]:
        """When (N,) and where (N, 3) the balls first come down to the table's plane, on the table or beside it, after a
        time; the nominal flight of row 0 says whether the fitted arc does or one after a bounce.
        """
        times = [time_down_to(arcs, BALL_RADIUS_M) for arcs in self.arcs]
        first = next((number for number, t in enumerate(times) if not t[0] <= after_s), len(times) - 1)
        return times[first], self.arcs[first].at(times[first][:, None])[:, 0]

    def at(self, t_s: Array) -> Array:
        """Positions (N, K, 3) at times (K,)."""
        ps = self.arcs[0].at(t_s)
        for arcs in self.arcs[1:]:
            with np.errstate(invalid="ignore"):
                later = t_s[None] >= arcs.t_s[:, None]
            ps = np.where(later[..., None], arcs.at(t_s), ps)
        return ps

    def nominal(self) -> Continuation:
        """Row 0 alone: the flight without its neighbours."""
        return Continuation(tuple(Arcs(arcs.t_s[:1], arcs.ps_m[:1], arcs.vs_mps[:1]) for arcs in self.arcs))

    def hits(self, x_m: float | Array) -> tuple[Array, Array]:
        """When (N,) each ball first crosses the plane x towards the robot, and its state (N, 6) there; nan if never.

        One plane for all, or one for each (N,).
        """
        count = len(self.arcs[0].t_s)
        t_hit, states = np.full(count, np.nan), np.full((count, 6), np.nan)
        for number, arcs in enumerate(self.arcs):
            t = time_back_to(arcs, x_m)
            start = arcs.t_s if number else np.full(count, -np.inf)
            end = self.arcs[number + 1].t_s if number + 1 < len(self.arcs) else np.full(count, np.nan)
            with np.errstate(invalid="ignore"):
                first = np.isnan(t_hit) & (t >= start) & ~(t >= end)
            t_hit = np.where(first, t, t_hit)
            here = np.concatenate([arcs.at(t[:, None])[:, 0], arcs.velocities_at(t)], axis=1)
            here[:, 0] = x_m
            states = np.where(first[:, None], here, states)
        return t_hit, states

    def crossings(self, xs_m: Array) -> tuple[Array, Array]:
        """(K, 7) time and state at planes (K,) of row 0, and (K, 7, 7) its covariance; nan where it never is."""
        each = [self.hits(float(x_m)) for x_m in xs_m]
        found = np.array([np.column_stack(one) for one in each]).reshape(len(each), -1, 7)
        moves = [one_sigma_moves(one) for one in found]
        spread = np.array([one.T @ one for one in moves]).reshape(-1, 7, 7)
        return found[:, 0], spread


def one_sigma_moves(values: Array) -> Array:
    """(K, ...) how much each unknown's sigma moves the value of row 0, given the values (1 + 2 K, ...) of all rows.

    Where a neighbour has no such value (it misses the table's edge, say), the difference to the other one counts.
    """
    up, down = values[1::2], values[2::2]
    up_there, down_there = np.isfinite(up), np.isfinite(down)
    both = (up - down) / 2
    one_side = np.where(up_there, up - values[0], values[0] - down)
    return np.where(up_there & down_there, both, np.where(up_there | down_there, one_side, 0.0))


def continue_flights(
    arcs: Arcs, restitution: Array, tangential: Array, *, max_bounces: int = MAX_BOUNCES
) -> Continuation:
    """The flights after the fitted arcs; `restitution`, `tangential` (N,): what the table keeps of the velocity.

    Args:
        arcs: N fitted parabolas.
        restitution: (N,) share of the vertical speed that a bounce keeps.
        tangential: (N,) share of the horizontal speed.
        max_bounces: bounces that are followed.
    """
    chain = [arcs]
    for _ in range(max_bounces):
        chain.append(reflect(chain[-1], restitution, tangential))
    return Continuation(tuple(chain))


def predict_arrivals(
    t_s: Array,
    ps_m: Array,
    observed: NDArray[np.bool_] | None = None,
    *,
    hit_x_m: float | Array,
    restitution: float,
    tangential_factor: float,
) -> tuple[Array, Array]:
    """The paper's prediction for N balls at once: p_c and v_c (N, 6) at the hitting plane and t_c (N,).

    From positions (N, K, 3) at times (N, K), all on one side of the bounce; before it the flight is continued over the
    table. nan where fewer than two points are observed or the ball does not come to the plane.

    Args:
        t_s: (N, K) times of the positions.
        ps_m: (N, K, 3) positions, world.
        observed: (N, K) which of them count; None: all.
        hit_x_m: x of the hitting plane, one or (N,).
        restitution: share of the vertical speed that the table keeps.
        tangential_factor: share of the horizontal speed.
    """
    n = len(t_s)
    # A second bounce on one half ends the rally: there is no stroke after it.
    flights = continue_flights(
        fit_arcs(t_s, ps_m, observed), np.full(n, restitution), np.full(n, tangential_factor), max_bounces=1
    )
    t_c, states = flights.hits(hit_x_m)
    return states, t_c
