"""What a person does about conflicts: take one's own label, the other's or the mean, and go to the next. Pure steps.

Each is an ordinary edit of one's own layer, with a provenance that says over which label of the other it was made;
undo brings the conflict back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from app.modes.label.commands.step import LabelEdit, LabelStep, Note
from app.modes.label.label_changes import ShownPicture
from app.modes.label.labelling import Labelling
from app.modes.label.merge.comparison import LabelComparison
from core.errors import LabelError
from labels.conflicts import Settled, settlement
from labels.model import Label, PositionSource
from labels.store import LabelStore

NOBODY: Final = Note("Nobody to compare with", "Choose whom in Compare and merge, in the panel.", "yellow")
NO_CONFLICT: Final = Note("No conflict here", "Shift N goes to the next one.", "yellow")
NO_MEAN: Final = Note("No mean of these", "Both must have seen the ball: J takes yours, L theirs.", "yellow")
ALL_SETTLED: Final = Note("No conflict is open", "All that differs is settled.", "green")


@dataclass(frozen=True, slots=True, eq=False)
class UseComparison:
    """Somebody else's labels beside one's own, or nobody's."""

    compared: LabelComparison | None

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        return LabelStep(replace(labelling, compared=self.compared))


@dataclass(frozen=True, slots=True)
class GoToConflict:
    """The next conflict that is open (+1), or the one before (-1)."""

    step: int

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        compared = labelling.compared_here
        if compared is None:
            return LabelStep(labelling, note=NOBODY)
        t_us = compared.next_open(labelling.t_us, self.step)
        return LabelStep(labelling, note=ALL_SETTLED) if t_us is None else LabelStep(labelling.at(t_us, wall_s))


@dataclass(frozen=True, slots=True)
class Settle:
    """Take a label for the conflict at the cursor, and go on to the next one.

    Where one has no label, the other's is taken over as it is.
    """

    how: Settled

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        compared, t_us, how = labelling.compared_here, labelling.t_us, self.how
        if compared is None:
            return LabelStep(labelling, note=NOBODY)
        mine = labelling.here.labels.get(t_us)
        theirs = compared.theirs_beside(t_us, mine)
        if theirs is None or (mine is None and how != "theirs"):
            return LabelStep(labelling, note=NO_CONFLICT)
        if how == "mean" and (mine is None or _mean(mine, theirs) is None):
            return LabelStep(labelling, note=NO_MEAN)
        if not labelling.on_screen:
            return LabelStep(labelling)  # what is not on the screen is not judged
        picture, name = labelling.judged_picture(wall_s), compared.theirs.annotator
        over = settlement(name, theirs, how)

        def act(store: LabelStore) -> tuple[int, ...]:
            before = store.at(t_us)
            if before is None:
                store.put(theirs)
                return (t_us,)
            label = settled_label(before, theirs, how, over, picture)
            if label is None:
                raise LabelError("nothing to take here", got=f"no mean at {t_us} us", remedy="J takes yours, L theirs")
            store.put(label)
            return (t_us,)

        further_us = compared.next_open(t_us, +1) if mine is not None else None
        after = replace(labelling, compared=compared.settled_at(t_us))
        return LabelStep(after.at(t_us if further_us is None else further_us, wall_s), LabelEdit(act))


@dataclass(frozen=True, slots=True)
class TakeMissing:
    """Take over every label of the other where one has none: one step of undo."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        compared = labelling.compared_here
        if compared is None:
            return LabelStep(labelling, note=NOBODY)
        name, theirs, times = compared.theirs.annotator, compared.theirs.labels, compared.only_theirs_us.tolist()
        if not times:
            return LabelStep(labelling, note=Note("Nothing to take over", f"You have all times of {name}.", "yellow"))
        taken: list[int] = []

        def act(store: LabelStore) -> tuple[int, ...]:
            known = store.by_time()
            labels = tuple(theirs[t_us] for t_us in times if t_us not in known and t_us in theirs)
            store.edit(put=labels)
            taken.append(len(labels))
            return tuple(label.t_us for label in labels)

        def said(_: object) -> Note:
            return Note("Taken over", f"{taken[0]} labels of {name}, as {name} made them; Z takes them back.", "green")

        return LabelStep(labelling, LabelEdit(act, said=said))


def settled_label(mine: Label, theirs: Label, how: Settled, over: str, picture: ShownPicture) -> Label | None:
    """The label that settles a conflict; None where it cannot be made: no mean without two balls.

    `over` is what `labels.conflicts.settlement` says of it.
    """
    taken = {"mine": mine, "theirs": theirs, "mean": _mean(mine, theirs)}.get(how)
    if taken is None:
        return None
    return replace(taken, provenance=picture.provenance(PositionSource.SETTLED, over))


def _mean(one: Label, other: Label) -> Label | None:
    """In the middle of both centres, with the mean radius, and the first one's state."""
    if not (one.state.seen and other.state.seen):
        return None
    assert one.x_px is not None and one.y_px is not None and other.x_px is not None and other.y_px is not None
    radii = [r_px for r_px in (one.r_px, other.r_px) if r_px is not None]
    return replace(
        one,
        x_px=one.x_px / 2 + other.x_px / 2,
        y_px=one.y_px / 2 + other.y_px / 2,
        r_px=sum(r_px / len(radii) for r_px in radii) if radii else None,
        covariance_px2=None,
    )
