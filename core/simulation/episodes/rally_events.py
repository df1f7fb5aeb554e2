"""What happens to the ball of a stepped rally: impacts, and passages that change nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.physics import crossing
from core.physics.contact import FLOOR_Z_M, HALF_WIDTH_M, over_table, overlaps_net
from core.physics.rotation import normals_from_orientations
from core.simulation.episodes.racket import RacketState
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]
RallyEventKind = Literal["serve", "bounce", "net", "end", "floor", "hit", "hit_plane", "net_plane", "down", "top"]
"""Impacts: bounce (table), net, end (of the table), floor, hit. Passages, which change nothing: hit_plane, net_plane,
down (to the table's plane, wherever), top (of an arc)."""

PASSAGES: Final[dict[int, RallyEventKind]] = {
    crossing.DOWN: "down",
    crossing.NET_PLANE: "net_plane",
    crossing.HIT_PLANE: "hit_plane",
    crossing.TOP_OF_ARC: "top",
}


@dataclass(frozen=True, slots=True, eq=False)
class RallyEvent:
    """Something that happened during a step."""

    kind: RallyEventKind
    t_s: float
    state: Array
    """(9,) ball position, velocity, spin: just after an impact, at a passage."""
    touched: Array
    """(9,) just before an impact; the same as `state` at a passage."""


def face_row(state: RacketState) -> Array:
    """(9,) position, velocity and normal of the racket's face, as `find_crossings` takes it."""
    return np.concatenate([state.p_m, state.v_mps, normals_from_orientations(state.q_wxyz)])


def impact_kind(
    which: int, state: Array, face_start: Array, face_end: Array, share: float, racket_radius_m: float
) -> RallyEventKind | None:
    """The impact that the crossing of plane `which` with ball `state` is, or None if the ball passes.

    `share` is how much of the step from `face_start` to `face_end` is over.
    """
    if which == crossing.DOWN:
        return "bounce" if over_table(state[0], state[1]) else None
    if which == crossing.NET_PLANE:
        return "net" if overlaps_net(state[1], state[2]) else None
    if which == crossing.END_PLANE:
        beside = abs(state[1]) > HALF_WIDTH_M
        return None if beside or not FLOOR_Z_M + BALL_RADIUS_M < state[2] < BALL_RADIUS_M else "end"
    if which == crossing.FLOOR_PLANE:
        return "floor"
    if which == crossing.FACE:
        centre = face_start[:3] + (face_end[:3] - face_start[:3]) * share
        normal = face_start[6:9] + (face_end[6:9] - face_start[6:9]) * share
        off = state[:3] - centre
        off = off - normal * (off @ normal) / (normal @ normal)
        return "hit" if off @ off <= racket_radius_m**2 else None
    return None
