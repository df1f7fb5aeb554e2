"""Whether what is shown is the answer to what is asked now; an answer that is not is marked soon, with why not."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final, Literal

from numba.core import event


class CompileCounter(event.Listener):
    """Counts the compilations that run; a kernel that is loaded from the cache is none."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.running = 0

    def on_start(self, event: event.Event) -> None:
        """Count a compilation that begins, in any thread."""
        with self._lock:
            self.running += 1

    def on_end(self, event: event.Event) -> None:
        """Count a compilation that has ended, well or not."""
        with self._lock:
            self.running -= 1


_COUNTER: Final = CompileCounter()
event.register("numba:compile", _COUNTER)


def is_compiling() -> bool:
    """Whether a kernel is being compiled, which takes seconds instead of milliseconds."""
    return _COUNTER.running > 0


GRACE_S: Final = 0.12
"""An answer that stays outdated for longer is marked: the mark is on the page within 200 ms."""
MOVING_GRACE_S: Final = 0.5
"""The same while time moves: there the shown picture is always a little behind."""
KEPT: Final = 4096
"""Most questions without an answer that are kept; the oldest are dropped."""
Staleness = Literal["", "computing", "compiling", "failed"]
"""Why the shown answer is not the current one; empty if it is, or has been until a moment ago."""


class AnswerFreshness:
    """Age of the shown answer, from the questions that were asked since; each question is an object of its own."""

    def __init__(self) -> None:
        self._asked: deque[tuple[object, float]] = deque(maxlen=KEPT)
        """The question of the shown answer, then the later ones, each with the time at which it was asked."""
        self._shown: object = None
        self._failed = False

    def ask(self, question: object, wall_s: float) -> None:
        """Note a question that will be answered or replaced by a newer one."""
        self._asked.append((question, wall_s))
        self._failed = False

    def answered(self, question: object) -> None:
        """Note that the answer to a question is shown now."""
        if all(asked is not question for asked, _ in self._asked):  # forgotten: no answer to what was asked since
            self._shown = None
            return
        while self._asked and self._asked[0][0] is not question:
            self._asked.popleft()
        self._shown = question

    def failed(self) -> None:
        """Note that the current question has no answer; the page has shown the reason."""
        self._failed = bool(self._asked)

    def forget(self) -> None:
        """Nothing is shown and nothing is asked."""
        self._asked.clear()
        self._shown, self._failed = None, False

    @property
    def is_waiting(self) -> bool:
        """Whether the answer to the current question is still to come."""
        return self._is_outdated and not self._failed

    @property
    def _is_outdated(self) -> bool:
        return bool(self._asked) and self._asked[-1][0] is not self._shown

    def staleness(self, wall_s: float, *, moving: bool) -> Staleness:
        """Whether to mark what is shown, and why; `moving`: the time cursor plays."""
        if not self._is_outdated:
            return ""
        if self._failed:
            return "failed"
        outdated_s = next(asked_s for question, asked_s in self._asked if question is not self._shown)
        if wall_s - outdated_s < (MOVING_GRACE_S if moving else GRACE_S):
            return ""
        return "compiling" if is_compiling() else "computing"
