"""What a command of Label leads to: the next state, what is to be saved, what is said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from app.modes.label.label_writer import Act, Saved
from app.modes.label.labelling import Labelling
from core.errors import LabelError
from labels.model import Label
from labels.store import LabelStore

Make = Callable[[Label | None], Label | None]
"""From the label that is there to the one that is to be there; None: impossible."""


@dataclass(frozen=True, slots=True)
class Note:
    """What is said to the person."""

    title: str
    text: str
    colour: str


@dataclass(frozen=True, slots=True, eq=False)
class LabelEdit:
    """A change of the layer that is labelled, carried out off the loop."""

    act: Act
    show: bool = False
    """Go to what was changed."""
    said: Callable[[Saved], Note | None] | None = None
    """What is said once it is saved."""
    then: Callable[[Saved], LabelCommand | None] | None = None
    """What is to be done once it was carried out."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelStep:
    """What a command leads to."""

    labelling: Labelling
    edit: LabelEdit | None = None
    note: Note | None = None
    partner_edit: LabelEdit | None = None
    """A change of the same person's layer of the other camera."""


class LabelCommand(Protocol):
    """One step of the labelling; `wall_s` is monotonic.

    Raises:
        CommandError: from `apply`, for a value that cannot be used; nothing changes.
    """

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep: ...


def change_label(labelling: Labelling, t_us: int, make: Make, wall_s: float, *, advance: bool = False) -> LabelStep:
    """Replace the label at a time by what is made of it, after all earlier changes."""

    def act(store: LabelStore) -> tuple[int, ...]:
        before = store.at(t_us)
        label = make(before)
        if label is None:
            raise LabelError("nothing to change at this time", where=f"{t_us} us", remedy="click the ball first")
        if label != before:
            store.put(label)
        return (t_us,)

    step = LabelStep(labelling, LabelEdit(act))
    return advanced(step, wall_s) if advance and t_us == labelling.t_us else step


def advanced(step: LabelStep, wall_s: float) -> LabelStep:
    """The same, and on to the next time; a second look ends by itself."""
    return step if step.labelling.view.blind else replace(step, labelling=step.labelling.moved(+1, wall_s))
