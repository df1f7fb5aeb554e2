"""Undo and redo of a value, where a slider's drag is one step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, TypeVar

V = TypeVar("V")

MERGE_WITHIN_S = 0.8
"""Changes of one setting closer than this are one step: a slider sends some twenty a second while it is dragged."""


@dataclass(frozen=True, slots=True)
class History(Generic[V]):
    """A value with its undo and redo history."""

    present: V
    past: tuple[V, ...] = ()
    future: tuple[V, ...] = ()
    last_topic: object = None
    last_wall_s: float = float("-inf")

    def change(self, value: V, *, topic: object, wall_s: float) -> History[V]:
        """History with a new value; merged with the previous step if that was recent and had the same topic."""
        if value == self.present:
            return self
        joins = topic is not None and topic == self.last_topic and wall_s - self.last_wall_s < MERGE_WITHIN_S
        past = self.past if joins else (*self.past, self.present)
        return History(value, past, (), topic, wall_s)

    def undo(self) -> History[V]:
        """History before the last step; unchanged if there is none."""
        if not self.past:
            return self
        return replace(self._at(self.past[-1]), past=self.past[:-1], future=(self.present, *self.future))

    def redo(self) -> History[V]:
        """History after redoing; unchanged if there is nothing to redo."""
        if not self.future:
            return self
        return replace(self._at(self.future[0]), past=(*self.past, self.present), future=self.future[1:])

    def _at(self, value: V) -> History[V]:
        return replace(self, present=value, last_topic=None)
