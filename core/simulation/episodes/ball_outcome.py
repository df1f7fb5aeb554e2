"""The umpire of a live rally: reads the events as they happen and says what came of each ball."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.physics.episode import Case
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import follow_hits
from core.simulation.episodes.rally_events import RallyEvent

Array = NDArray[np.float64]


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
