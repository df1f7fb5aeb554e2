"""Labels by hand: frozen commands, each a pure step to what is to be saved.

A label is made when its turn to be saved comes, off the loop, from the one that is in the store by then: keys in quick
succession all count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from app.modes.label.commands.step import LabelEdit, LabelStep, Note, advanced, change_label
from app.modes.label.label_changes import copied, label_from_click, moved, placed, snapped, with_state
from app.modes.label.label_writer import Saved
from app.modes.label.labelling import Labelling, UnfitClick
from app.modes.label.sources import LabelSource
from core.errors import LabelError
from core.events import Events
from labels.model import Label, LabelState
from labels.store import LabelStore, UndoStep

SNAP_REACH_US: Final = 17_000
MIN_RADIUS_PX: Final = 0.5
FIRST_RADIUS_PX: Final = 5.0
"""What a radius that was never given is resized from."""


@dataclass(frozen=True, slots=True)
class PlaceBall:
    """The ball is here, in the picture that is shown; with a radius where a circle was drawn."""

    x_px: float
    y_px: float
    r_px: float | None = None

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        shown = labelling.shown
        drawn = self.r_px is None or self.r_px > 0
        if shown is None or shown.main.camera != labelling.view.camera or not drawn:
            return LabelStep(labelling)
        t_us, source = shown.t_us, labelling.source
        picture = labelling.at(t_us, labelling.arrived_s).picture_to_label(wall_s)
        draft = labelling.draft(t_us)
        snap = labelling.view.snap and source.stream is not None and self.r_px is None

        unfit: list[UnfitClick] = []

        def act(store: LabelStore) -> tuple[int, ...]:
            label = label_from_click(self.x_px, self.y_px, picture, store.at(t_us), draft, r_px=self.r_px)
            label = snapped(label, _near(source, t_us)) if snap else label
            if label.r_px is None:
                unfit.append(UnfitClick(labelling.layer, t_us, self.x_px, self.y_px, snap))
                return ()
            store.put(label)
            return (t_us,)

        def then(_: Saved) -> AskRadius | None:
            return AskRadius(unfit[0]) if unfit else None

        step = LabelStep(replace(labelling, click=None), LabelEdit(act, then=then))
        return advanced(step, wall_s) if labelling.view.advance and t_us == labelling.t_us else step


@dataclass(frozen=True, slots=True)
class AskRadius:
    """A click found no circle: nothing is stored until somebody says how large the ball is."""

    click: UnfitClick

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        if labelling.layer != self.click.layer:
            return LabelStep(labelling)
        return LabelStep(replace(labelling.at(self.click.t_us, wall_s), click=self.click))


@dataclass(frozen=True, slots=True)
class SetNumbers:
    """Position and radius typed in."""

    x_px: float
    y_px: float
    r_px: float | None

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        picture = labelling.picture_to_label(wall_s)

        def make(before: Label | None) -> Label:
            if self.r_px is None and (before is None or before.r_px is not None):
                remedy = "type one, or drag from the centre to the rim"
                raise LabelError("a ball needs a radius", expected="above 0 px", got="0", remedy=remedy)
            if before is None:
                return label_from_click(self.x_px, self.y_px, picture, None, None, r_px=self.r_px)
            return placed(before, self.x_px, self.y_px, self.r_px, picture)

        return change_label(labelling, labelling.t_us, make, wall_s)


@dataclass(frozen=True, slots=True)
class Nudge:
    """Move the label a little."""

    dx_px: float
    dy_px: float

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        picture = labelling.picture_to_label(wall_s)
        return change_label(
            labelling,
            labelling.t_us,
            lambda before: moved(before, self.dx_px, self.dy_px, picture) if before else None,
            wall_s,
        )


@dataclass(frozen=True, slots=True)
class Resize:
    """Make the radius larger or smaller."""

    by_px: float

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        picture, click = labelling.picture_to_label(wall_s), labelling.asking

        def make(before: Label | None) -> Label | None:
            if before is None and click is not None:
                r_px = FIRST_RADIUS_PX + self.by_px
                return label_from_click(click.x_px, click.y_px, picture, None, None, r_px=r_px)
            if before is None or before.x_px is None or before.y_px is None:
                return None
            r_px = max((before.r_px or FIRST_RADIUS_PX) + self.by_px, MIN_RADIUS_PX)
            return placed(before, before.x_px, before.y_px, r_px, picture)

        return change_label(labelling, labelling.t_us, make, wall_s)


@dataclass(frozen=True, slots=True)
class SetState:
    """Say what is seen; go on after the states that need no position."""

    state: LabelState

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        t_us, picture = labelling.t_us, labelling.picture_to_label(wall_s)
        draft = labelling.draft(t_us)
        away = self.state in (LabelState.NO_BALL, LabelState.OUT_OF_FRAME)
        return change_label(
            labelling, t_us, lambda before: with_state(self.state, before, draft, picture), wall_s, advance=away
        )


@dataclass(frozen=True, slots=True)
class CopyPrevious:
    """The latest label before this time, here too."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        t_us, picture = labelling.t_us, labelling.picture_to_label(wall_s)

        def act(store: LabelStore) -> tuple[int, ...]:
            earlier = store.labels().between(0, t_us)
            label = store.at(int(earlier.t_us[-1])) if len(earlier) else None
            if label is None:
                raise LabelError("no label before this time", where=f"{t_us} us")
            store.put(copied(label, picture))
            return (t_us,)

        return LabelStep(labelling, LabelEdit(act))


@dataclass(frozen=True, slots=True)
class SnapLabel:
    """Move the label to the circle that fits the events."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        t_us, source = labelling.t_us, labelling.source

        def make(before: Label | None) -> Label | None:
            return snapped(before, _near(source, t_us)) if before and before.x_px is not None else None

        return change_label(labelling, t_us, make, wall_s)


@dataclass(frozen=True, slots=True)
class Clear:
    """Make a time unchecked again."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        t_us = labelling.t_us
        return LabelStep(labelling, LabelEdit(lambda store: (t_us,) if store.delete(t_us) else ()))


@dataclass(frozen=True, slots=True)
class UndoLabel:
    """Take back, or bring back, what this browser changed last, and show it. What others did stays."""

    redo: bool = False

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        steps: list[UndoStep] = []

        def act(store: LabelStore) -> tuple[int, ...]:
            steps.append(store.step_back(redo=self.redo))
            return steps[0].touched_us

        return LabelStep(labelling, LabelEdit(act, show=True, said=lambda _: _undo_note(steps[0], self.redo)))


@dataclass(frozen=True, slots=True)
class ToggleBreak:
    """A bounce or hit at this time, or no longer. Kept while the recording is open in this browser."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        breaks_us = tuple(sorted(set(labelling.breaks_us) ^ {labelling.t_us}))
        return LabelStep(replace(labelling, breaks_us=breaks_us))


def _undo_note(step: UndoStep, redo: bool) -> Note | None:
    what = "Redo" if redo else "Undo"
    if not step.done:
        return Note(f"Nothing to {what.lower()}", "Only what this window did under this name is taken back.", "yellow")
    if not step.left_us:
        return None
    where = f"at {step.left_us[0] / 1e6:.6f} s" if len(step.left_us) == 1 else f"at {len(step.left_us)} times"
    return Note(f"{what}: left as it is", f"Somebody else has changed the label {where} since.", "yellow")


def _near(source: LabelSource, t_us: int) -> Events:
    return source.events(max(t_us - SNAP_REACH_US, 0), t_us + SNAP_REACH_US)
