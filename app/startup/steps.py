"""Steps of a start with progress, shared by all browsers and the terminal."""

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
    """One step."""

    title: str
    hint: str = ""
    """Hint: its duration or purpose."""
    state: State = "waiting"
    share: float = 0.0
    """Share that is done, 0 to 1."""
    problem: str = ""
    """Why it failed."""
    began_s: float = 0.0
    """Monotonic time at which it began, s."""


class Preparation:
    """Steps by name, in order. All methods may be called from any thread."""

    def __init__(self, steps: dict[str, Step], say: Callable[[str], None] = lambda line: None) -> None:
        """`say` gets a line when a long step begins, at every quarter of it, and at its end."""
        self._steps = dict(steps)
        self._say = say
        self._reported: dict[str, float] = {}
        self._lock = threading.Lock()

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps."""
        with self._lock:
            return tuple(self._steps.values())

    @property
    def over(self) -> bool:
        """Whether all steps are done."""
        return all(step.state == "done" for step in self.steps)

    def begin(self, name: str) -> None:
        """Mark a step as running."""
        with self._lock:
            self._steps[name] = replace(self._steps[name], state="running", began_s=time.monotonic())

    def advance(self, name: str, share: float) -> None:
        """Update the share of a step that is done."""
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
        """Mark a step as failed."""
        with self._lock:
            step = self._steps[name]
            self._steps[name] = replace(step, state="failed", problem=problem)
            self._say(f"{step.title}: failed ({problem})")
