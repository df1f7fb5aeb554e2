"""What a person does about conflicts: take one's own label, the other's or the mean, and go to the next.

Each is an ordinary edit of one's own layer, with a provenance that says over which label of the other it was made;
undo brings the conflict back.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Final

from app.modes.label.editor import LabelEditor
from app.modes.label.label_changes import ShownPicture
from core.errors import LabelError
from core.text import counted
from labels.conflicts import Settled, settlement
from labels.model import Label, PositionSource
from labels.store import LabelStore

NOBODY: Final = ("No second annotator is chosen", "Choose one under Compare and merge in the panel.")


def go_to_conflict(editor: LabelEditor, step: int) -> None:
    """Go to the next conflict that is open (+1), or to the one before (-1)."""
    compared = editor.labelling.compared_here
    if compared is None:
        editor.note(*NOBODY)
        return
    t_us = compared.next_open(editor.labelling.t_us, step)
    if t_us is None:
        editor.note("No conflict is open", "All conflicts are resolved.", "green")
    else:
        editor.go_to(t_us)


def resolve_conflict(editor: LabelEditor, how: Settled) -> None:
    """Take a label for the conflict at the cursor, and go on to the next one.

    Where one has no label, the other's is taken over as it is.
    """
    now, compared, t_us = editor.labelling, editor.labelling.compared_here, editor.labelling.t_us
    if compared is None:
        editor.note(*NOBODY)
        return
    mine = now.here.labels.get(t_us)
    theirs = compared.theirs_beside(t_us, mine)
    if theirs is None or (mine is None and how != "theirs"):
        editor.note("No conflict here", "Shift N goes to the next one.")
        return
    if how == "mean" and (mine is None or _mean(mine, theirs) is None):
        editor.note("No mean of these", "Both must have seen the ball: J takes yours, L theirs.")
        return
    if not now.on_screen:
        return  # what is not on the screen is not judged
    picture, over = now.judged_picture(time.monotonic()), settlement(compared.theirs.annotator, theirs, how)

    def change(store: LabelStore) -> tuple[int, ...]:
        before = store.at(t_us)
        label = theirs if before is None else resolved_label(before, theirs, how, over, picture)
        if label is None:
            raise LabelError("nothing to take here", got=f"no mean at {t_us} us", remedy="J takes yours, L theirs")
        store.put(label)
        return (t_us,)

    if editor.write(change):
        editor.compare_with(compared.resolved_at(t_us))
        further_us = compared.next_open(t_us, +1) if mine is not None else None
        editor.go_to(t_us if further_us is None else further_us)


def take_missing(editor: LabelEditor) -> None:
    """Take over every label of the other where one has none: one step of undo."""
    compared = editor.labelling.compared_here
    if compared is None:
        editor.note(*NOBODY)
        return
    name, theirs, times = compared.theirs.annotator, compared.theirs.labels, compared.only_theirs_us.tolist()
    if not times:
        editor.note("Nothing to take over", f"You have all times of {name}.")
        return
    taken: list[int] = []

    def change(store: LabelStore) -> tuple[int, ...]:
        known = store.by_time()
        labels = tuple(theirs[t_us] for t_us in times if t_us not in known and t_us in theirs)
        store.edit(put=labels)
        taken.append(len(labels))
        return tuple(label.t_us for label in labels)

    def then(_: object) -> None:
        labels = counted(taken[0], "label")
        editor.note("Taken over", f"{labels} of {name}, as {name} made them; Z takes back this step.", "green")

    editor.write(change, then=then)


def resolved_label(mine: Label, theirs: Label, how: Settled, over: str, picture: ShownPicture) -> Label | None:
    """The label that resolves a conflict; None where it cannot be made: no mean without two balls.

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
    # Halved before they are added: the sum of two finite numbers of a stranger's store may not be finite.
    return replace(
        one,
        x_px=one.x_px / 2 + other.x_px / 2,
        y_px=one.y_px / 2 + other.y_px / 2,
        r_px=sum(r_px / len(radii) for r_px in radii) if radii else None,
        covariance_px2=None,
    )
