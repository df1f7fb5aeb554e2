"""Outcomes of strokes for sources that do not report them, classified from the chain's points; and returns counted by
controller and scene.

A ball that came and was not struck is no outcome here: perhaps there was no racket at all.
"""

from __future__ import annotations

import contextlib
import logging
import math
import queue
import threading
from dataclasses import dataclass
from typing import Final

from core.chain.chain import ChainState
from core.chain.control.controller import RacketDecision
from core.history.rally_history import Outcome, RallyHistory
from core.history.rally_picture import LandingSpot
from core.metrics.score import binomial_interval
from core.outcomes import ClassifiedStroke, OutcomeClassifier
from core.physics.episode import Case

logger = logging.getLogger(__name__)


MAX_WAITING: Final = 2_000
"""Steps of the chain, four seconds of them; what comes when so many wait is not judged."""


def note_stroke(history: RallyHistory, judged: ClassifiedStroke | None) -> None:
    """Add a classification to a history, if it is of a stroke."""
    if judged is not None and judged.case is not Case.MISSED:
        history.add_outcome(outcome_as_judged(judged))


def outcome_as_judged(judged: ClassifiedStroke) -> Outcome:
    """For a history: a ball whose serve was not seen is said to have been served when it was judged."""
    serve = judged.serve
    x, y, _ = judged.landing_m.tolist()
    served_us, speed_mps = (judged.t_us, float("nan")) if serve is None else (serve.t_us, serve.speed_mps)
    return Outcome(judged.t_us, served_us, speed_mps, LandingSpot(x, y, judged.case))


class SeenOutcomes:
    """Classifies on a thread of its own, as it takes longer than a step of the chain may. `close` it."""

    def __init__(self, history: RallyHistory) -> None:
        self._history = history
        self._session = 0
        self._steps: queue.Queue[tuple[int, ChainState, RacketDecision | None] | None] = queue.Queue(MAX_WAITING)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="seen-outcomes", daemon=True)
        self._thread.start()

    def add_step(self, state: ChainState, decision: RacketDecision | None = None) -> None:
        """The next step of the chain, and where the racket is sent to meet the ball; returns at once."""
        try:
            self._steps.put_nowait((self._session, state, decision))
        except queue.Full:
            logger.debug("a step was not judged")

    def begin_anew(self) -> None:
        """Reset for a new session."""
        self._session += 1

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        with contextlib.suppress(queue.Full):  # wakes the thread
            self._steps.put_nowait(None)
        self._thread.join()

    def _run(self) -> None:
        judge, session = OutcomeClassifier(), 0
        while not self._ended.is_set():
            item = self._steps.get()
            if item is None or item[0] != self._session:
                continue
            if item[0] != session:
                session = item[0]
                judge.reset()
            note_stroke(self._history, judge.step(*item[1:]))


@dataclass(frozen=True, slots=True)
class BallConditions:
    """Conditions of a ball."""

    controller: str
    """Name of the controller."""
    scene: str
    """Name of the scene; empty if unknown."""


@dataclass(frozen=True, slots=True)
class ReturnRate:
    """Balls of one controller in one scene."""

    conditions: BallConditions
    balls: int
    """At least one."""
    returned: int
    speeds_mps: tuple[float, float] = (math.nan, math.nan)
    """Slowest and fastest serve among them."""

    @property
    def share(self) -> float:
        """Share of returned balls, 0 to 1."""
        return self.returned / self.balls

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share."""
        return binomial_interval(self.share, self.balls)


class ReturnCounts:
    """Counts whole balls of a live rally. Safe to use from several threads.

    A ball counts only if all of it was seen, and if neither the controller nor the scene was changed during it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: dict[BallConditions, ReturnRate] = {}
        self._begun: BallConditions | None = None

    def begin_ball(self, conditions: BallConditions) -> None:
        """Start a ball."""
        with self._lock:
            self._begun = conditions

    def end_ball(self, conditions: BallConditions, *, returned: bool, speed_mps: float = math.nan) -> bool:
        """End the ball that was served last, at `speed_mps`, with its outcome; returns whether it counts."""
        with self._lock:
            begun, self._begun = self._begun, None
            if begun != conditions:
                return False
            so_far = self._counts.get(conditions, ReturnRate(conditions, 0, 0, (math.inf, -math.inf)))
            slowest, fastest = so_far.speeds_mps
            speeds_mps = min(speed_mps, slowest), max(speed_mps, fastest)
            self._counts[conditions] = ReturnRate(conditions, so_far.balls + 1, so_far.returned + returned, speeds_mps)
            return True

    def drop_ball(self) -> None:
        """Do not count the current ball: its session is over."""
        with self._lock:
            self._begun = None

    def clear(self) -> None:
        """Begin anew; a ball that flies counts already."""
        with self._lock:
            self._counts.clear()

    def rates(self) -> tuple[ReturnRate, ...]:
        """Return rates, in the order of first occurrence."""
        with self._lock:
            return tuple(self._counts.values())
