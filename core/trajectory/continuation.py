"""A fitted flight continued to the table, off it, and to the hitting plane: many flights at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.table import BALL_RADIUS_M
from core.trajectory.arc import Arcs, fit_arcs, reflect, time_back_to, time_down_to

Array = NDArray[np.float64]
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

    def hits(self, x_m: float) -> tuple[Array, Array]:
        """When (N,) each ball first crosses the plane x towards the robot, and its state (N, 6) there; nan if never."""
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


def continue_flights(
    arcs: Arcs, restitution: Array, tangential: Array, *, max_bounces: int = MAX_BOUNCES
) -> Continuation:
    """The flights after the fitted arcs; `restitution`, `tangential` (N,): what the table keeps of the velocity."""
    chain = [arcs]
    for _ in range(max_bounces):
        chain.append(reflect(chain[-1], restitution, tangential))
    return Continuation(tuple(chain))


def predict_arrivals(
    t_s: Array,
    ps_m: Array,
    observed: NDArray[np.bool_] | None = None,
    *,
    hit_x_m: float,
    restitution: float,
    tangential_factor: float,
) -> tuple[Array, Array]:
    """The paper's prediction for N balls at once: p_c and v_c (N, 6) at the hitting plane and t_c (N,).

    From positions (N, K, 3) at times (N, K), all on one side of the bounce; before it the flight is continued over the
    table. nan where fewer than two points are observed or the ball does not come to the plane.
    """
    n = len(t_s)
    flights = continue_flights(
        fit_arcs(t_s, ps_m, observed), np.full(n, restitution), np.full(n, tangential_factor), max_bounces=1
    )
    t_c, states = flights.hits(hit_x_m)
    return states, t_c
