"""What a person does with proposals: accept one, all of a time, a segment or a flight; reject; interpolate."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.modes.label.by_hand import events_near
from app.modes.label.editor import LabelEditor
from app.modes.label.label_changes import ProposedLabel, ShownPicture, accepted, proposed_at, snapped
from app.modes.label.label_writer import Change, Saved
from app.modes.label.labelling import CameraWork, Labelling
from app.modes.label.sightings import FROM_OTHERS, draft_at
from app.modes.label.sources import LabelSource
from core.text import counted
from labels.assist import Proposals, WholeFlight, check_stereo, labels_between, steady_segment
from labels.assist.stereo import median_over_cameras
from labels.assist.whole_flight import Doubt
from labels.model import Label
from labels.store import LabelStore

SEGMENT_US: Final = 2_000_000
"""Interpolation looks so far round the cursor."""
SAME_BALL_PX: Final = 3.0
"""A circle that is farther from where the other cameras have the ball is not taken for it, nor one that is farther than
half a radius."""
NO_PROPOSALS: Final = ("No proposals here", "I runs the detector from the cursor on.")


def accept(editor: LabelEditor) -> None:
    """Label what is proposed here, and go on. Where nothing is proposed, only go on."""
    now = editor.labelling
    if not now.on_screen:
        return
    draft = draft_at(now, now.t_us)
    if draft is not None:
        if not _in_sight(editor, draft):
            return
        picture, source, snap = now.judged_picture(time.monotonic()), now.source, now.view.snap
        if not editor.change_label(lambda before: before or _accepted_label(draft, picture, source, snap=snap)):
            return
    editor.step(+1)


def accept_all(editor: LabelEditor) -> None:
    """Label what is proposed here in every camera, as one step of undo, and go on.

    The cursor stays where these labels place the ball in further cameras: what is proposed there is to be seen first.
    """
    now = editor.labelling
    if not now.on_screen or now.view.repeat:
        return
    names = (now.view.camera, *(other.name for other in now.others))
    drafts = {name: draft for name in names if (draft := draft_at(now, now.t_us, name)) is not None}
    own = drafts.get(now.view.camera)
    if own is not None and not _in_sight(editor, own):
        return
    picture, snap = now.judged_picture(time.monotonic()), now.view.snap
    # The time that was spent is counted once, for the camera that was looked at.
    elsewhere = replace(picture, time_spent_ms=0)

    def change_of(name: str, draft: ProposedLabel) -> Change:
        judged = picture if name == now.view.camera else elsewhere

        def change(store: LabelStore) -> tuple[int, ...]:
            if store.at(draft.t_us) is not None:
                return ()
            store.put(_accepted_label(draft, judged, now.sources[name], snap=snap))
            return (draft.t_us,)

        return change

    if drafts and not editor.write_all({name: change_of(name, draft) for name, draft in drafts.items()}):
        return
    works = dict(now.works)
    for name, draft in drafts.items():
        label = accepted(draft, elsewhere)
        works[name] = replace(works[name], labels={**works[name].labels, now.t_us: label})
    then = replace(now, works=works)
    if not drafts or not any(draft_at(then, now.t_us, name) for name in names):
        editor.step(+1)


def reject(editor: LabelEditor) -> None:
    """Keep that what is proposed here is wrong, and do not show it any more."""
    now, draft = editor.labelling, draft_at(editor.labelling, editor.labelling.t_us)
    if not now.on_screen or draft is None or not _in_sight(editor, draft):
        return

    def change(store: LabelStore) -> tuple[int, ...]:
        store.reject(draft.t_us, draft.x_px, draft.y_px, draft.r_px, draft.detector)
        return ()

    if editor.write(change):
        rejecting = replace(now.here, rejected=now.here.rejected | {(draft.t_us, draft.detector)})
        editor.labelling = replace(now, works={**now.works, now.view.camera: rejecting})


def accept_segment(editor: LabelEditor) -> None:
    """Accept every proposal round here that its neighbours and the other cameras bear out, as one step of undo."""
    now, proposals = editor.labelling, editor.labelling.here.proposals
    if not now.on_screen or now.view.repeat:
        return
    if proposals is None:
        editor.note(*NO_PROPOSALS)
        return
    rows = steady_segment(proposals, now.t_us, stereo_residual_px=_stereo_residual_px(now, proposals))
    if not len(rows):
        text = "The proposals around the cursor contradict each other. Look at each: space accepts, R rejects."
        editor.note("Not accepted", text)
        return
    first_us, last_us = proposals.t_us[rows[[0, -1]]].tolist()
    labels = _accepted_labels(now, now.here, proposals, _times_between(now, first_us, last_us))
    if editor.write(_put_new(labels), then=lambda saved: _note_stored(editor, "Segment accepted", saved)):
        editor.go_to(now.grid.moved(last_us, +1))


def _note_stored(editor: LabelEditor, title: str, saved: Saved) -> None:
    """Say how many labels are on the disk; the times of a segment may all have labels already."""
    count = len(saved.touched_us)
    if count:
        editor.note(title, f"{counted(count, 'label')}; Z takes back all of this step.", "green")
    else:
        editor.note("Nothing to accept", "Every time of this segment has a label, or its proposal was rejected.")


def interpolate(editor: LabelEditor) -> None:
    """Label the unchecked times between labels round here: by a flight in 3D if one fits, else by a curve."""
    now = editor.labelling
    times = _times_between(now, now.t_us - SEGMENT_US, now.t_us + SEGMENT_US)
    cameras = tuple(now.rig.values())
    contacts_us = [contact.t_us for other in now.others for contact in now.works[other.name].contacts]
    others = [now.works[name].arrays for name in now.rig if name != now.view.camera]

    def change(store: LabelStore) -> tuple[int, ...]:
        breaks_us = (*contacts_us, *(contact.t_us for contact in store.contacts()))
        labels = labels_between(store.labels(), others, cameras, times, now.t_us, breaks_us)
        store.edit(put=labels)
        return tuple(label.t_us for label in labels)

    def then(saved: Saved) -> None:
        count = len(saved.touched_us)
        if count:
            editor.note("Interpolated", f"{counted(count, 'label')}; Z takes back this step", "green")
        else:
            editor.note("Not interpolated", "Needs five labels without a gap, and unchecked times between them.")

    editor.write(change, then=then)


def accept_flight(editor: LabelEditor, cameras: tuple[str, ...], found: WholeFlight) -> None:
    """Label every time of a flight at which the proposals agree with it, as one step of undo.

    `cameras` are those of the flight, the labelled one first. The cursor goes to the first doubted proposal of that, or
    behind the flight.
    """
    now = editor.labelling
    if now.view.repeat:
        return
    labels = {
        name: _accepted_labels(now, now.works[name], agreed, _undoubted_times(now, agreed, doubted))
        for name, agreed, doubted in zip(cameras, found.agreed, found.doubted, strict=True)
    }
    doubted_us, elsewhere = doubted_times(now, found), sum(map(len, found.doubted[1:]))
    if not editor.write_all({name: _put_new(new) for name, new in labels.items() if new or name == now.view.camera}):
        return
    pair = len(cameras) == 2
    count, where = sum(map(len, labels.values())), "both cameras" if pair else f"{len(cameras)} cameras"
    text = f"{counted(count, 'label')} in {where}; Z takes back this step."
    if doubted_us or elsewhere:
        others = "the other camera" if pair else "the other cameras"
        text += f" To check: {len(doubted_us)} here, {elsewhere} in {others}. K leads through them."
    editor.note("Flight accepted", text, "green")
    editor.go_to(doubted_us[0] if doubted_us else now.grid.moved(found.end_us, +1))


def doubted_times(now: Labelling, found: WholeFlight) -> tuple[int, ...]:
    """Times to be labelled at which the proposal is off the flight, and nobody has said anything."""
    off = {doubt.t_us for doubt in found.doubted[0]}
    times = _times_between(now, found.start_us, found.end_us).tolist()
    return tuple(t_us for t_us in times if t_us in off and now.here.draft(t_us) is not None)


def _in_sight(editor: LabelEditor, draft: ProposedLabel) -> bool:
    """Whether what is proposed lies in the large picture; if not, the picture goes there instead of the act."""
    now = editor.labelling
    if now.shown is not None and now.shown.main.region.holds(draft.x_px, draft.y_px):
        return True
    view = replace(now.view, centre_px=(draft.x_px, draft.y_px))
    if view != now.view:
        editor.labelling = replace(now, view=view)
        text = "The proposal was outside the picture. It is visible now: press the key again."
        editor.note("Not judged yet", text)
    return False


def _times_between(now: Labelling, first_us: int, last_us: int) -> NDArray[np.int64]:
    times = now.grid.times()
    return times[(times >= first_us) & (times <= last_us)]


def _undoubted_times(now: Labelling, agreed: Proposals, doubted: tuple[Doubt, ...]) -> NDArray[np.int64]:
    """Times to be labelled; not where a doubted proposal is next, which nothing must bridge."""
    if not len(agreed):
        return np.zeros(0, np.int64)
    times = _times_between(now, int(agreed.t_us[0]), int(agreed.t_us[-1]))
    doubted_us = np.array([doubt.t_us for doubt in doubted], np.int64)
    return times[(np.abs(times[:, None] - doubted_us) >= agreed.window_us).all(axis=1)]


def _accepted_labels(
    now: Labelling, work: CameraWork, proposals: Proposals, times: NDArray[np.int64]
) -> tuple[Label, ...]:
    """What is proposed at these times, as labels; not where there is a label, or where it was rejected."""
    picture = replace(now.judged_picture(time.monotonic()), time_spent_ms=0)
    known, rejected = work.labels, work.rejected
    open_us = (t_us for t_us in times.tolist() if t_us not in known and (t_us, proposals.detector) not in rejected)
    drafts = (draft for t_us in open_us if (draft := proposed_at(proposals, t_us)) is not None)
    return tuple(accepted(draft, replace(picture, t_us=draft.t_us)) for draft in drafts)


def _accepted_label(draft: ProposedLabel, picture: ShownPicture, source: LabelSource, *, snap: bool) -> Label:
    """The label that a draft becomes; one that follows from other cameras is moved to the circle next to it."""
    label = accepted(draft, picture)
    if draft.detector != FROM_OTHERS or not snap or source.stream is None:
        return label
    fitted = snapped(label, events_near(source, draft.t_us))
    if math.dist((fitted.x_px or 0.0, fitted.y_px or 0.0), (draft.x_px, draft.y_px)) > max(
        SAME_BALL_PX, 0.5 * (draft.r_px or 0.0)
    ):
        return label
    return replace(fitted, provenance=label.provenance)


def _put_new(labels: tuple[Label, ...]) -> Change:
    """Store those labels whose times have none, as one step of undo."""

    def change(store: LabelStore) -> tuple[int, ...]:
        new = tuple(label for label in labels if store.at(label.t_us) is None)
        store.edit(put=new)
        return tuple(label.t_us for label in new)

    return change


def _stereo_residual_px(now: Labelling, proposals: Proposals) -> NDArray[np.float64] | None:
    """(n,) how far each proposal is from most other cameras' rays; None without calibrations or proposals there."""
    here_px, rig = np.column_stack([proposals.x_px, proposals.y_px]), now.rig
    residuals = []
    for name in rig:
        there = now.works[name].proposals
        if name != now.view.camera and there is not None:
            other = there.at(proposals.t_us)
            there_px = np.column_stack([other.x_px, other.y_px])
            residuals.append(check_stereo(rig[now.view.camera], here_px, rig[name], there_px).residual_px)
    return median_over_cameras(residuals)
