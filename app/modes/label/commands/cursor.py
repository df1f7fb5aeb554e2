"""What a person may ask of the cursor and of what is shown: frozen commands, each a pure step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.modes.label.commands.step import LabelStep, Note
from app.modes.label.labelling import Labelling
from app.modes.label.view import WINDOWS_US, ZOOMS


@dataclass(frozen=True, slots=True)
class ChangeView:
    """Take over other choices of what is shown, by the name of `LabelView`'s field."""

    changes: Mapping[str, Any]

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        view = replace(labelling.view, **self.changes)
        if view.camera not in labelling.sources or view.window_us not in WINDOWS_US or view.zoom not in ZOOMS:
            return LabelStep(labelling)
        before, saved = labelling.view, labelling.saved
        if (view.annotator, view.camera) != (before.annotator, before.camera):
            view = replace(view, blind=False, centre_px=None)
        compared = labelling.compared
        if (view.annotator, view.camera) != (before.annotator, before.camera):
            compared = None
        if view.annotator != before.annotator:
            saved = {}
        return LabelStep(replace(labelling, view=view, saved=saved, compared=compared))


@dataclass(frozen=True, slots=True)
class SetAnnotator:
    """Another person labels, under a name that `annotator_from` has made."""

    name: str

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        return ChangeView({"annotator": self.name}).apply(labelling, wall_s)


@dataclass(frozen=True, slots=True)
class OtherCamera:
    """The next camera of the recording."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        names = tuple(labelling.sources)
        name = names[(names.index(labelling.view.camera) + 1) % len(names)]
        return ChangeView({"camera": name}).apply(labelling, wall_s)


@dataclass(frozen=True, slots=True)
class GoTo:
    """Move the time cursor."""

    t_us: int

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        return LabelStep(labelling.at(self.t_us, wall_s))


@dataclass(frozen=True, slots=True)
class StepBy:
    """To the next or previous time that is to be labelled, or some further."""

    steps: int

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        return LabelStep(labelling.moved(self.steps, wall_s))


@dataclass(frozen=True, slots=True)
class GoToEnd:
    """To the first or the last time that is to be labelled."""

    last: bool

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        grid = labelling.grid
        return LabelStep(labelling.at(grid.last_us if self.last else int(grid.times()[:1].sum()), wall_s))


@dataclass(frozen=True, slots=True)
class GoToUnchecked:
    """To the next time that nobody has looked at; round to the start once."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        times = labelling.grid.times()
        left = times[~np.isin(times, labelling.here.arrays.t_us)]
        if not len(left):
            note = Note("Everything is checked", "No unchecked time is left in this camera.", "green")
            return LabelStep(labelling, note=note)
        row = int(np.searchsorted(left, labelling.t_us, side="right")) % len(left)
        return LabelStep(labelling.at(int(left[row]), wall_s))


@dataclass(frozen=True, slots=True)
class BeginSecondLook:
    """Ask for the label at a time again, without showing it."""

    t_us: int

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        view = replace(labelling.view, blind=True)
        return LabelStep(replace(labelling, view=view, back_us=labelling.t_us).at(self.t_us, wall_s))


@dataclass(frozen=True, slots=True)
class Escape:
    """Forget a click that waits for its radius; else leave the second look."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        if labelling.asking is not None:
            return LabelStep(replace(labelling, click=None))
        return LeaveSecondLook().apply(labelling, wall_s)


@dataclass(frozen=True, slots=True)
class LeaveSecondLook:
    """Back to where it was begun, answered or not."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        if not labelling.view.blind:
            return LabelStep(labelling)
        view = replace(labelling.view, blind=False)
        return LabelStep(replace(labelling, view=view).at(labelling.back_us, wall_s))
