"""The steps of a start, in words, with progress; shared by all browsers and the terminal."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, Literal

State = Literal["waiting", "running", "done", "failed"]
SAY_EVERY: Final = 0.25


@dataclass(frozen=True, slots=True)
class Step:
    """One thing to do."""

    title: str
    hint: str = ""
    """How long it takes, or what it is for."""
    state: State = "waiting"
    share: float = 0.0
    """Done of it, 0 to 1."""
    problem: str = ""
    """Why it failed."""
    began_s: float = 0.0
    """Monotonic."""


class Preparation:
    """Steps by name, in order. All methods may be called from any thread."""

    def __init__(self, steps: dict[str, Step], say: Callable[[str], None] = lambda line: None) -> None:
        """`say` hears a line when a step that takes a while begins, at every quarter of it, and when it ends."""
        self._steps = dict(steps)
        self._say = say
        self._reported: dict[str, float] = {}
        self._lock = threading.Lock()

    @property
    def steps(self) -> tuple[Step, ...]:
        """All, as they are now."""
        with self._lock:
            return tuple(self._steps.values())

    @property
    def over(self) -> bool:
        """Whether nothing is left to be done or to be read: all steps are done."""
        return all(step.state == "done" for step in self.steps)

    def begin(self, name: str) -> None:
        """A step is under way."""
        with self._lock:
            self._steps[name] = replace(self._steps[name], state="running", began_s=time.monotonic())

    def advance(self, name: str, share: float) -> None:
        """So much of it is done."""
        with self._lock:
            step = self._steps[name]
            if step.state != "running" or share < step.share:
                return
            self._steps[name] = replace(step, share=share)
            if name not in self._reported:
                self._reported[name] = 0.0
                self._say(f"{step.title}{f', {step.hint}' if step.hint else ''} ...")
            elif share - self._reported[name] >= SAY_EVERY:
                self._reported[name] = share - share % SAY_EVERY
                self._say(f"{step.title}: {share:.0%}")

    def finish(self, name: str) -> None:
        """Mark the step as done."""
        with self._lock:
            step = self._steps[name]
            self._steps[name] = replace(step, state="done", share=1.0)
            if name in self._reported:
                self._say(f"{step.title}: done after {time.monotonic() - step.began_s:.0f} s")

    def fail(self, name: str, problem: str) -> None:
        """It cannot be done."""
        with self._lock:
            step = self._steps[name]
            self._steps[name] = replace(step, state="failed", problem=problem)
            self._say(f"{step.title}: failed ({problem})")
