"""Labels with help: what the detector proposes, whole segments, interpolation. Frozen commands, each a pure step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.modes.label.commands.step import LabelEdit, LabelStep, Note, change_label
from app.modes.label.label_changes import ProposedLabel, accepted, proposed_at
from app.modes.label.label_writer import Saved
from app.modes.label.labelling import Labelling
from labels.assist import Proposals, check_stereo, labels_between, steady_segment
from labels.assist.propose import joined_proposals
from labels.store import LabelStore

SEGMENT_US: Final = 2_000_000
"""Interpolation looks so far round the cursor."""


@dataclass(frozen=True, slots=True, eq=False)
class AddProposals:
    """What the detector found next, by camera; both cameras' at once, so that a segment is judged with both."""

    parts: Mapping[str, Proposals]

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        works = dict(labelling.works)
        for camera, part in self.parts.items():
            works[camera] = replace(works[camera], proposals=joined_proposals(works[camera].proposals, part))
        return LabelStep(replace(labelling, works=works))


@dataclass(frozen=True, slots=True)
class Accept:
    """What is proposed here is right; go on. Where nothing is proposed, only go on."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        if not labelling.on_screen:
            return LabelStep(labelling)
        draft, step = labelling.draft(labelling.t_us), LabelStep(labelling)
        if draft is not None and not _seen(labelling, draft):
            return _looked_at(labelling, draft)
        if draft is not None:
            label = accepted(draft, labelling.judged_picture(wall_s))
            step = change_label(labelling, labelling.t_us, lambda before: before or label, wall_s)
        return replace(step, labelling=labelling.moved(+1, wall_s))


@dataclass(frozen=True, slots=True)
class Reject:
    """What is proposed here is wrong; it is kept that it is, and not shown any more."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        here, draft = labelling.here, labelling.draft(labelling.t_us)
        if not labelling.on_screen or draft is None:
            return LabelStep(labelling)
        if not _seen(labelling, draft):
            return _looked_at(labelling, draft)

        def act(store: LabelStore) -> tuple[int, ...]:
            store.reject(draft.t_us, draft.x_px, draft.y_px, draft.r_px, draft.detector)
            return ()

        rejecting = replace(here, rejected=here.rejected | {(draft.t_us, draft.detector)})
        works = {**labelling.works, labelling.view.camera: rejecting}
        return LabelStep(replace(labelling, works=works), LabelEdit(act))


@dataclass(frozen=True, slots=True)
class AcceptSegment:
    """Accept every proposal round here that its neighbours and the other camera bear out, as one step of undo."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        here = labelling.here
        if not labelling.on_screen or labelling.view.blind:
            return LabelStep(labelling)
        if here.proposals is None:
            return LabelStep(
                labelling, note=Note("No proposals here", "I runs the detector from the cursor on.", "yellow")
            )
        residual_px = _stereo_residual_px(labelling, here.proposals)
        rows = steady_segment(here.proposals, labelling.t_us, stereo_residual_px=residual_px)
        if not len(rows):
            text = "The proposals round here do not agree with each other. Look at each: space accepts, R rejects."
            return LabelStep(labelling, note=Note("Not at once", text, "yellow"))
        first_us, last_us = here.proposals.t_us[rows[[0, -1]]].tolist()
        picture = replace(labelling.judged_picture(wall_s), time_spent_ms=0)
        labels = tuple(
            accepted(draft, replace(picture, t_us=draft.t_us))
            for draft in _unjudged(labelling, here.proposals, first_us, last_us)
        )

        def act(store: LabelStore) -> tuple[int, ...]:
            new = tuple(label for label in labels if store.at(label.t_us) is None)
            store.edit(put=new)
            return tuple(label.t_us for label in new)

        note = Note("Segment accepted", f"{len(labels)} labels; Z takes them all back", "green")
        return LabelStep(labelling.at(labelling.grid.moved(last_us, +1), wall_s), LabelEdit(act), note)


@dataclass(frozen=True, slots=True)
class Interpolate:
    """Label the unchecked times between labels round here: by a flight in 3D if one fits, else by a curve."""

    def apply(self, labelling: Labelling, wall_s: float) -> LabelStep:
        t_us, times = labelling.t_us, labelling.grid.times()
        times = times[(times >= t_us - SEGMENT_US) & (times <= t_us + SEGMENT_US)]
        there = None if labelling.there is None else labelling.there.arrays
        cameras, breaks_us = labelling.calibrations, labelling.breaks_us

        def act(store: LabelStore) -> tuple[int, ...]:
            labels = labels_between(store.labels(), there, cameras, times, t_us, breaks_us)
            store.edit(put=labels)
            return tuple(label.t_us for label in labels)

        return LabelStep(labelling, LabelEdit(act, said=_interpolated))


def _seen(labelling: Labelling, draft: ProposedLabel) -> bool:
    return labelling.shown is not None and labelling.shown.main.region.holds(draft.x_px, draft.y_px)


def _looked_at(labelling: Labelling, draft: ProposedLabel) -> LabelStep:
    """What is proposed lies outside the picture: the picture goes there, and the key is for nothing."""
    view = replace(labelling.view, centre_px=(draft.x_px, draft.y_px))
    if view == labelling.view:
        return LabelStep(labelling)
    note = Note(
        "Not judged yet", "What is proposed was outside the picture. Now it is in it: press the key again.", "yellow"
    )
    return LabelStep(replace(labelling, view=view), note=note)


def _unjudged(labelling: Labelling, proposals: Proposals, first_us: int, last_us: int) -> tuple[ProposedLabel, ...]:
    here, times = labelling.here, labelling.grid.times()
    times = times[(times >= first_us) & (times <= last_us)].tolist()
    open_us = (t_us for t_us in times if t_us not in here.labels and (t_us, proposals.detector) not in here.rejected)
    return tuple(draft for t_us in open_us if (draft := proposed_at(proposals, t_us)) is not None)


def _stereo_residual_px(labelling: Labelling, proposals: Proposals) -> NDArray[np.float64] | None:
    """(n,) how far each proposal is from the partner's ray; None without calibrations or proposals there."""
    cameras, there = labelling.calibrations, labelling.there
    if cameras is None or there is None or there.proposals is None:
        return None
    other = there.proposals.at(proposals.t_us)
    here_px = np.column_stack([proposals.x_px, proposals.y_px])
    return check_stereo(cameras[0], here_px, cameras[1], np.column_stack([other.x_px, other.y_px])).residual_px


def _interpolated(saved: Saved) -> Note:
    count = len(saved.touched_us)
    if not count:
        return Note("Interpolated", "It takes five labels without a break between.", "yellow")
    return Note("Interpolated", f"{count} labels; Z takes them back", "green")
