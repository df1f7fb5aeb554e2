"""Events of a stepped rally: impacts, passages that change nothing, and what became of each ball."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.physics import crossing
from core.physics.contact import FLOOR_Z_M, HALF_WIDTH_M, over_table, overlaps_net
from core.physics.episode import Case, Outcomes
from core.physics.rotation import normals_from_orientations
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import follow_hits
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

    Args:
        which: index of the plane, of `core.physics.crossing`.
        state: (9,) ball at the crossing.
        face_start: (9,) position, velocity and normal of the racket's face at the start of the step.
        face_end: (9,) the same at its end.
        share: of the step that is over at the crossing, 0 to 1.
        racket_radius_m: of the face.
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
        # Divided by its square: an interpolated normal is shorter than 1.
        off = off - normal * (off @ normal) / (normal @ normal)
        return "hit" if off @ off <= racket_radius_m**2 else None
    return None


@dataclass(frozen=True, slots=True, eq=False)
class BallOutcome:
    """What came of one ball of a rally."""

    case: Case
    t_s: float
    """When it was decided."""
    landing_m: Array
    """(3,) where the ball would come down to the table's plane; NaN for a miss."""
    landing_v_mps: Array
    """(3,) its velocity there; NaN for a miss."""
    net_z_m: float
    """Height of its centre over the net plane; NaN for a miss or a ball that does not get there."""


class RallyClassifier:
    """Decides each served ball once: at the first contact after the racket, or when no racket can reach it any more."""

    def __init__(self, task: TaskConfig) -> None:
        self._task = task
        self._pending = False
        self._bounces = 0
        self._was_service = False
        self._hit: RallyEvent | None = None

    def feed(self, events: Iterable[RallyEvent]) -> tuple[BallOutcome, ...]:
        """The balls that these events decide. Feed every event, the serve too, in order."""
        return tuple(outcome for event in events if (outcome := self._feed_one(event)) is not None)

    def _feed_one(self, event: RallyEvent) -> BallOutcome | None:
        if event.kind == "serve":
            unfinished = self._decide(Case.MISSED, event.t_s) if self._pending else None
            self._pending, self._bounces, self._hit, self._was_service = True, 0, None, False
            return unfinished
        if not self._pending:
            return None
        if event.kind == "hit":
            self._hit = self._hit or event
        elif event.kind == "floor":
            return self._decide(Case.OUT if self._hit else Case.MISSED, event.t_s)
        elif event.kind in ("net", "end", "bounce"):
            if self._hit is None:
                return self._come_down(event)
            return self._decide(case_of(event), event.t_s)
        return None

    def _come_down(self, event: RallyEvent) -> BallOutcome | None:
        """Before the racket: a second bounce on a half, the net or the table's end, and the ball is dead.

        Only a service bounces on the other half, and it does so first.
        """
        on_far_half = event.kind == "bounce" and event.touched[0] > 0
        if on_far_half and not self._bounces and not self._was_service:
            self._was_service = True
            return None
        self._bounces += 1
        dead = event.kind != "bounce" or on_far_half or self._bounces > 1
        return self._decide(Case.MISSED, event.t_s) if dead else None

    def _decide(self, case: Case, t_s: float) -> BallOutcome:
        self._pending = False
        nowhere = np.full(3, np.nan)
        if self._hit is None or case is Case.MISSED:
            return BallOutcome(Case.MISSED, t_s, nowhere, nowhere, float("nan"))
        flight = follow_hits(np.array([self._hit.t_s]), self._hit.state[None], self._task)
        landing = flight.landing_states[0]
        return BallOutcome(case, t_s, landing[:3], landing[3:6], float(flight.net_z_m[0]))


def case_of(event: RallyEvent) -> Case:
    """The case of a first contact with table or net."""
    if event.kind == "net":
        return Case.NET
    if event.touched[0] < 0:
        return Case.OWN_HALF
    return Case.RETURNED if event.kind == "bounce" else Case.OUT


def outcomes_of(ball: BallOutcome, served_s: float) -> Outcomes:
    """One row: what learning needs of a ball that was judged in the world, with times since its serve.

    The world reports where the ball comes down and how high it crosses the net; when it was hit and how it left the
    racket stay unknown (NaN), and so do spins.
    """
    landing = np.concatenate([ball.landing_m, ball.landing_v_mps, np.full(3, np.nan)])[None]
    contact = landing.copy()
    contact_t_s, landing_t_s = np.array([ball.t_s - served_s]), np.array([ball.t_s - served_s])
    if ball.case is Case.NET:
        # Decided at the net, before the ball would have come down.
        contact[0, 0], landing_t_s[0] = 0.0, np.inf
    elif ball.case is Case.MISSED:
        contact_t_s[0] = landing_t_s[0] = np.nan
    return Outcomes(
        case=np.array([ball.case], np.int8),
        hit_t_s=np.full(1, np.nan),
        hit_states=np.full((1, 9), np.nan),
        landing_t_s=landing_t_s,
        landing_states=landing,
        net_z_m=np.array([ball.net_z_m]),
        contact_t_s=contact_t_s,
        contact_states=contact,
    )
