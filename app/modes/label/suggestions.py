"""Label suggestions: what the detector proposes and how it is judged, whole flights, suspicious labels, repeats."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.background.jobs import LatestWins, LoopJob
from app.formatting import percent
from app.modes.label.contacts import ContactSearch
from app.modes.label.editor import LabelEditor, events_near
from app.modes.label.label_changes import ProposedLabel, ShownPicture, accepted, proposed_at, snapped
from app.modes.label.label_writer import Change, Saved
from app.modes.label.labelling import CameraWork, Labelling
from app.modes.label.sightings import FROM_OTHERS, draft_at
from app.modes.label.sources import LabelSource
from app.modes.label.status import Checked, checked_of
from core.detection.saved import SavedDetector
from core.metrics.at_times import LEAD_IN_US
from core.recordings import CameraStream
from labels.assist import (
    Proposals,
    WholeFlight,
    check_stereo,
    labels_between,
    next_blind,
    propose,
    review_queue,
    steady_segment,
    whole_flight,
)
from labels.assist.propose import joined_proposals
from labels.assist.review import QueueItem
from labels.assist.stereo import StereoCheck, labelled_positions_at, median_over_cameras
from labels.assist.whole_flight import Doubt
from labels.model import ContactLabel, Label
from labels.store import LabelStore

SEGMENT_US: Final = 2_000_000
"""Interpolation looks so far round the cursor."""
CHUNK_US: Final = 100_000
SHORTEST_CHUNK_US: Final = 20_000
"""In a short recording: each chunk is handed over by itself, and tells how far the detector is."""
SAME_BALL_PX: Final = 3.0
"""A circle that is farther from where the other cameras have the ball is not taken for it, nor one that is farther than
half a radius."""
NO_PROPOSALS: Final = ("No proposals here", "I runs the detector from the cursor on.")


class LabelSuggestions:
    """Work in the background that suggests labels to one browser. Methods are called by the loop."""

    def __init__(self, editor: LabelEditor, pool: Executor) -> None:
        self._editor = editor
        self._job = LoopJob[None](editor.callbacks.later, editor.callbacks.report)
        self._reached_us = 0
        """The detector that runs has handed over everything before this time."""
        self._visited: set[tuple[str, int]] = set()
        self.reason = ""
        """Why the cursor was sent here."""
        self.reason_us = -1
        self._doubted: Label | None = None
        """The label that it speaks of."""
        self._queue_work, self._flight_work = self._background(pool), self._background(pool)

    @property
    def share(self) -> float | None:
        """How much of the recording the detector has been through since its start; None: it is not running."""
        return self._job.share

    def reason_for(self, label: Label | None) -> str:
        """Why the cursor was sent to where it is now; nothing once the label there is another one."""
        here = self.reason_us == self._editor.labelling.t_us and label == self._doubted
        return self.reason if here else ""

    def close(self) -> None:
        """The browser or the recording is gone."""
        self._queue_work.close()
        self._flight_work.close()
        self._job.close()

    def _background(self, pool: Executor) -> LatestWins[Callable[[], Callable[[], None]], Callable[[], None]]:
        """Runs work off the loop; what the work returns is then called by the loop."""
        later = self._editor.callbacks.later
        return LatestWins(pool, lambda work: work(), lambda work, then: later(then), self._editor.failed)

    def _give_reason(self, reason: str, t_us: int) -> None:
        self.reason, self.reason_us = reason, t_us
        self._doubted = self._editor.labelling.here.labels.get(t_us)

    # Proposals ----------------------------------------------------------------------------------------------------

    def toggle_propose(self, detector: SavedDetector) -> None:
        """Run the detector from the cursor to the end, in all cameras; or stop it."""
        if self._job.running:
            self._job.cancel()
            return
        labelling = self._editor.labelling
        sources = (labelling.source, *labelling.others)
        streams = [source.stream for source in sources if source.stream is not None]
        if not streams:
            self._editor.note("No proposals here", "The detector works on events, not on frames.")
            return
        # From a little before the cursor: what is proposed there is judged by its neighbours on both sides.
        window_us = detector.config.window.window_us
        start_us = self._reached_us = max(labelling.t_us - LEAD_IN_US, 0) // window_us * window_us
        end_us, contacts = labelling.recording.duration_us, ContactSearch(labelling.rig, start_us)
        self._job.start(
            lambda progress, cancelled: self._propose(
                streams, (start_us, end_us), detector, contacts, progress, cancelled
            ),
            lambda _: None,
        )

    def _propose(
        self,
        streams: list[CameraStream],
        span: tuple[int, int],
        detector: SavedDetector,
        contacts: ContactSearch,
        progress: Callable[[float], None],
        cancelled: Callable[[], bool],
    ) -> None:
        start_us, end_us = span
        window_us, span_us = detector.config.window.window_us, max(end_us - start_us, 1)
        chunk_us = min(max(span_us // 10, SHORTEST_CHUNK_US), CHUNK_US) // window_us * window_us or window_us
        for begin_us in range(start_us, end_us, chunk_us):
            reached_us, parts = begin_us + chunk_us, {}
            lead_us = max(begin_us - LEAD_IN_US // window_us * window_us, 0)
            for stream in streams:
                if cancelled():
                    return
                found = propose(
                    stream, lead_us, min(reached_us, end_us), method=detector.method, config=detector.config
                )
                parts[stream.name] = found.between(begin_us, reached_us + 1)
            touches = contacts.add(parts, reached_us, last=reached_us >= end_us)
            self._editor.callbacks.later(
                lambda parts=parts, t_us=reached_us, touches=touches: (
                    None if cancelled() else self._take(parts, t_us, touches, start_us)
                )
            )
            progress(min((reached_us - start_us) / span_us, 1.0))

    def _take(
        self,
        parts: dict[str, Proposals],
        reached_us: int,
        contacts: tuple[ContactLabel, ...] | None,
        start_us: int,
    ) -> None:
        add_proposals(self._editor, parts)
        if contacts is not None:
            now = self._editor.labelling
            earlier = tuple(contact for contact in now.proposed_contacts if contact.t_us < start_us)
            self._editor.labelling = replace(now, proposed_contacts=earlier + contacts)
        self._reached_us = reached_us

    @property
    def segment_due(self) -> bool:
        """What is proposed round the cursor is on the screen, as far as the detector will find anything there."""
        labelling = self._editor.labelling
        finding = self._job.running and self._reached_us <= labelling.t_us + LEAD_IN_US
        return labelling.view.repeat or (labelling.on_screen and not finding)

    # Whole flights ------------------------------------------------------------------------------------------------

    def take_flight(self) -> None:
        """Accept every proposal of the flight round the cursor, in all cameras; go to what is doubted."""
        now, editor = self._editor.labelling, self._editor
        if not now.on_screen or now.view.repeat:
            return
        parts = {name: now.works[name].proposals for name in now.rig}
        given = {name: part for name, part in parts.items() if part is not None}
        if not now.rig:
            text = "It needs two calibrated cameras. Enter accepts the proposals on a smooth path in one."
            editor.note("No flight here", text)
        elif now.view.camera not in given or len(given) < 2:
            editor.note(*NO_PROPOSALS)
        else:
            cameras, place = [now.rig[name] for name in given], (now.view.camera, now.t_us)

            def find() -> Callable[[], None]:
                found = whole_flight(cameras, tuple(given.values()), place[1])
                return lambda: self._take_flight(place, tuple(given), found)

            self._flight_work.submit(find)

    def _take_flight(self, place: tuple[str, int], cameras: tuple[str, ...], found: WholeFlight | None) -> None:
        now = self._editor.labelling
        if place != (now.view.camera, now.t_us):
            return  # the person went elsewhere
        if found is None:
            where = "both cameras" if len(cameras) == 2 else "the cameras"
            text = f"The proposals around the cursor in {where} are not one ball in free flight."
            self._editor.note("No flight here", text)
            return
        doubted_us = doubted_times(now, found)
        if doubted_us:
            off_px = next(doubt.off_px for doubt in found.doubted[0] if doubt.t_us == doubted_us[0])
            self._give_reason(f"{off_px:.1f} px off the flight", doubted_us[0])
        self._editor.do(lambda editor: accept_flight(editor, cameras, found))

    # The queue ----------------------------------------------------------------------------------------------------

    def next_suspicious(self) -> None:
        """Work out what is suspicious, and go to the worst that was not visited yet."""
        now = self._editor.labelling

        def find() -> Callable[[], None]:
            items = _suspicious(now)
            return lambda: self._go_to_worst(now.view.camera, items)

        self._queue_work.submit(find)

    def _go_to_worst(self, camera: str, items: tuple[QueueItem, ...]) -> None:
        if camera != self._editor.labelling.view.camera:
            return
        item = next((item for item in items if (camera, item.t_us) not in self._visited), None)
        if item is None:
            self._visited.clear()
            self._note_end(bool(items))
            return
        self._visited.add((camera, item.t_us))
        self._give_reason(item.reason, item.t_us)
        self._editor.go_to(item.t_us)

    def _note_end(self, visited: bool) -> None:
        here = self._editor.labelling.here
        if not len(here.arrays) and not here.proposals:
            self._editor.note("Nothing to check", "No labels or proposals here yet: click a ball, or press I.")
            return
        if visited:
            text, open_ends = "All items were visited. Press again to start over.", False
        else:
            text, open_ends = nothing_suspicious_words(checked_of(self._editor.labelling), self.share)
        self._editor.note("Queue", text, "yellow" if open_ends else "green")

    # Repeat annotations -------------------------------------------------------------------------------------------

    def repeat_annotation(self) -> None:
        """Ask for a label again, without showing it."""
        editor, now = self._editor, self._editor.labelling
        if now.view.repeat:
            return
        picked: list[int] = []

        def pick(repeats: LabelStore) -> tuple[int, ...]:
            t_us = next_blind(editor.writer.store(now.layer), repeats, recent_us=now.recent_us)
            picked.extend([] if t_us is None else [t_us])
            return ()

        def done(_: Saved) -> None:
            editor.callbacks.later(lambda: self._begin_repeat(picked))

        editor.writer.write(replace(now.layer, blind=True), pick, done, editor.failed)

    def _begin_repeat(self, picked: list[int]) -> None:
        if picked:
            self._editor.begin_repeat(picked[0])
        else:
            text = "One label in twenty is repeated, after twenty others."
            self._editor.note("No second look is due", text, "green")


def nothing_suspicious_words(checked: Checked, share: float | None) -> tuple[str, bool]:
    """What an empty queue means, and whether more may be found later.

    Args:
        checked: how far the camera is.
        share: how far the detector is, while it runs.
    """
    left = checked.total - checked.checked
    ends = [f"{left} {'time' if left == 1 else 'times'} unchecked"] if left else []
    ends += [] if share is None else [f"proposals {percent(share)} done"]
    return f"Nothing suspicious so far; {', '.join(ends)}." if ends else "No label or proposal looks wrong.", bool(ends)


def add_proposals(editor: LabelEditor, parts: Mapping[str, Proposals]) -> None:
    """Take up what the detector found next, by camera; all cameras' at once: a segment is judged with all."""
    works = dict(editor.labelling.works)
    for camera, part in parts.items():
        works[camera] = replace(works[camera], proposals=joined_proposals(works[camera].proposals, part))
    editor.labelling = replace(editor.labelling, works=works)


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
    """Label what is proposed here in every camera, as one step of undo in each, and go on.

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
        editor.note(title, f"{count} {'label' if count == 1 else 'labels'}; Z takes back all of this step.", "green")
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
            editor.note("Interpolated", f"{count} labels; Z takes them back", "green")
        else:
            editor.note("Not interpolated", "Needs five labels without a gap, and unchecked times between them.")

    editor.write(change, then=then)


def accept_flight(editor: LabelEditor, cameras: tuple[str, ...], found: WholeFlight) -> None:
    """Label every time of a flight at which the proposals agree with it: one step of undo in each camera.

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
    text = f"{count} labels in {where}; Z takes back those of this camera."
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


def _check_with(now: Labelling, other: str) -> StereoCheck:
    """Each of the n labels of the labelled camera beside another camera's ball; nan where that has none.

    The other's ball is its label, the curve through its labels or, where those say nothing, its proposal: the same that
    the panel says how well the cameras agree with.
    """
    labels, work = now.here.arrays, now.works[other]
    there_px = labelled_positions_at(work.arrays, labels.t_us)
    if work.proposals is not None:
        proposed, unknown = work.proposals.at(labels.t_us), np.isnan(there_px[:, 0])
        there_px[unknown] = np.column_stack([proposed.x_px, proposed.y_px])[unknown]
    here_px = np.column_stack([labels.x_px, labels.y_px])
    here_px[~labels.seen] = np.nan
    return check_stereo(now.rig[now.view.camera], here_px, now.rig[other], there_px)


def _suspicious(now: Labelling) -> tuple[QueueItem, ...]:
    """What is to be looked at in the labelled camera, the worst first."""
    here, rig = now.here, now.rig
    checks = [
        _check_with(now, name)
        for name in rig
        if name != now.view.camera and len(here.arrays) and (len(now.works[name].arrays) or now.works[name].proposals)
    ]
    return review_queue(
        here.arrays,
        proposals=here.proposals,
        stereo_residual_px=median_over_cameras([check.residual_px for check in checks]),
        expected_r_px=median_over_cameras([check.expected_r_px[:, 0] for check in checks]),
        frames_us=now.grid.times(),
        rejected_us=tuple(t_us for t_us, _ in here.rejected),
    )
