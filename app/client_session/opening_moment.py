"""A new browser's first view of the live rally: the first bounce in slow motion.

The rally itself goes on as it is; only this browser's time cursor is slow, from just before a bounce until the ball
has come back, and then live again. Whatever the person does with the controls meanwhile ends it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from app.state.client_state import ClientState, Playhead
from core.history.rally_history import RallyHistory

BEFORE_US: Final = 80_000
AFTER_US: Final = 120_000
"""Time after the bounce during which it is slowest."""
LATE_US: Final = 300_000
"""A bounce longer ago than this is not shown."""
RETURN_US: Final = 400_000
"""Time after the hit until the ball has landed on the other side."""
USUAL_FLIGHT_US: Final = 450_000
"""Assumed time from bounce to hit where no hit is predicted."""
SLOWEST: Final = 0.05
SLOW: Final = 0.1


@dataclass(frozen=True, slots=True)
class Bounce:
    """A bounce to show, from shortly before it until the ball has returned."""

    begin_us: int
    t_us: int
    """Predicted or observed time of the bounce."""
    back_us: int


def bounce_near(history: RallyHistory, now_us: int) -> Bounce | None:
    """Bounce predicted next or just observed; None if there is none, or the ball is not seen."""
    step = history.at(now_us, {}).step
    if step is None or step.before is None or not step.before.prediction.bounces:
        return None
    t_us = round(step.before.prediction.bounces[0].t_s * 1e6)
    if not t_us - BEFORE_US <= now_us <= t_us + LATE_US:
        return None
    begin_us = min(now_us, t_us - BEFORE_US)
    picture = history.at(begin_us, {}).picture
    if picture.ball is None or not len(picture.tube):
        return None
    hit = step.before.hit
    hit_us = t_us + USUAL_FLIGHT_US if hit is None else round(hit.t_s * 1e6)
    return Bounce(begin_us, t_us, hit_us + RETURN_US)


class OpeningMoment:
    """Slow motion when a browser opens a live rally. Called by that browser's loop."""

    def __init__(self, begun: Callable[[], None]) -> None:
        """`begun` is called when the slow motion begins."""
        self._begun = begun
        self._left: ClientState | None = None
        self._bounce: Bounce | None = None
        self.over = False

    def follow(self, state: ClientState, history: RallyHistory | None, wall_s: float) -> ClientState:
        """State with the cursor moved; if the user has changed the cursor, the slow motion ends."""
        if self.over:
            return state
        if self._left is not None and _caught_up(self._left) == state.without_growth():  # the rally is paused
            self.over = True
            return replace(state, playhead=state.playhead.at_speed(1.0, wall_s).play(wall_s))
        untouched = self._left is None or state.without_growth() == self._left
        if not untouched or history is None or not state.playhead.live:
            self.over = True
            return state
        head = self._steered(state.playhead, history, wall_s)
        state = replace(state, playhead=head)
        self._left = state.without_growth()
        return state

    def _steered(self, head: Playhead, history: RallyHistory, wall_s: float) -> Playhead:
        if self._bounce is None:
            self._bounce = bounce_near(history, history.followed_us)
            if self._bounce is None:
                return head
            self._begun()
            return head.seek(self._bounce.begin_us, wall_s).at_speed(SLOWEST, wall_s)
        position_us = head.position_us(wall_s)
        if position_us >= self._bounce.back_us:
            self.over = True
            return replace(head.at_speed(1.0, wall_s), playing=True, following=True)
        if position_us >= self._bounce.t_us + AFTER_US and head.speed != SLOW:
            return head.at_speed(SLOW, wall_s)
        return head


def _caught_up(slow: ClientState) -> ClientState | None:
    """Cursor that a slow one becomes when it reaches the live end; None for a cursor that is not slow."""
    return None if slow.playhead.following else replace(slow, playhead=replace(slow.playhead, following=True))
