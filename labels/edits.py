"""Edits of labels with undo and redo without limit. Knows no files: the store replays its journal through it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from labels.model import Label


@dataclass(frozen=True, slots=True)
class Edit:
    """One act of a person, one step of undo: some labels put (added or replaced), some times deleted."""

    seq: int
    """Number of its line in the journal."""
    put: tuple[Label, ...] = ()
    delete: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class _Step:
    """An edit as it happened: what stood there before and after."""

    seq: int
    before: tuple[tuple[int, Label | None], ...]
    after: tuple[tuple[int, Label | None], ...]


class EditHistory:
    """The labels that edits have led to, and the way back.

    An edit after an undo makes what was undone unreachable by redo, as in every editor; the journal still has it.
    """

    def __init__(self) -> None:
        self._labels: dict[int, Label] = {}
        self._done: list[_Step] = []
        self._undone: list[_Step] = []

    @property
    def labels(self) -> Mapping[int, Label]:
        """By time, in no order; deleted ones are absent."""
        return MappingProxyType(self._labels)

    @property
    def undoable(self) -> int | None:
        """The number of the edit that an undo would take back."""
        return self._done[-1].seq if self._done else None

    @property
    def redoable(self) -> int | None:
        """The number of the edit that a redo would bring back."""
        return self._undone[-1].seq if self._undone else None

    def apply(self, edit: Edit) -> tuple[int, ...]:
        """Carry out an edit; returns the times it touched."""
        after: dict[int, Label | None] = dict.fromkeys(edit.delete)
        after.update((label.t_us, label) for label in edit.put)
        before = tuple((t_us, self._labels.get(t_us)) for t_us in after)
        self._done.append(_Step(edit.seq, before, tuple(after.items())))
        self._undone.clear()
        return self._go_to(tuple(after.items()))

    def undo(self) -> tuple[int, ...]:
        """Take back the latest edit that stands; returns the times it touched, () if there is none."""
        if not self._done:
            return ()
        step = self._done.pop()
        self._undone.append(step)
        return self._go_to(step.before)

    def redo(self) -> tuple[int, ...]:
        """Bring back the edit that was undone last; returns the times it touched, () if there is none."""
        if not self._undone:
            return ()
        step = self._undone.pop()
        self._done.append(step)
        return self._go_to(step.after)

    def _go_to(self, states: tuple[tuple[int, Label | None], ...]) -> tuple[int, ...]:
        for t_us, label in states:
            if label is None:
                self._labels.pop(t_us, None)
            else:
                self._labels[t_us] = label
        return tuple(t_us for t_us, _ in states)
