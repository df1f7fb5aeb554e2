"""Label suggestions: what the detector proposes, whole flights, suspicious labels, repeats."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from typing import Final

import numpy as np

from app.background.jobs import LatestWins, LoopJob
from app.formatting import percent
from app.modes.label.accepting import NO_PROPOSALS, accept_flight, doubted_times
from app.modes.label.contacts import ContactSearch
from app.modes.label.editor import LabelEditor
from app.modes.label.label_writer import Saved
from app.modes.label.labelling import Labelling
from app.modes.label.status import Checked, checked_of
from core.detection.saved import SavedDetector
from core.metrics.at_times import LEAD_IN_US
from core.recordings import CameraStream
from core.text import counted
from labels.assist import Proposals, WholeFlight, check_stereo, next_blind, propose, review_queue, whole_flight
from labels.assist.propose import joined_proposals
from labels.assist.review import QueueItem
from labels.assist.stereo import StereoCheck, labelled_positions_at, median_over_cameras
from labels.model import ContactLabel, Label
from labels.store import LabelStore

CHUNK_US: Final = 100_000
LISTED: Final = "in the list to label"
SHORTEST_CHUNK_US: Final = 20_000
"""In a short recording: each chunk is handed over by itself, and tells how far the detector is."""


class LabelSuggestions:
    """Work in the background that suggests labels to one browser. Methods are called by the loop."""

    def __init__(
        self, editor: LabelEditor, pool: Executor, listed: Callable[[str], tuple[int, ...]] = lambda uuid: ()
    ) -> None:
        """`listed` gives the times of a recording, by its uuid, that somebody wants to have labelled."""
        self._editor = editor
        self._listed = listed
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
        """Go to the first of the list of moments to label that has none, else to what is most suspicious, once each."""
        now = self._editor.labelling

        def find() -> Callable[[], None]:
            items = (*_wanted(now, self._listed(now.recording.uuid)), *_suspicious(now))
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
    ends = [f"{counted(left, 'time')} unchecked"] if left else []
    ends += [] if share is None else [f"proposals {percent(share)} done"]
    return f"Nothing suspicious so far; {', '.join(ends)}." if ends else "No label or proposal looks wrong.", bool(ends)


def add_proposals(editor: LabelEditor, parts: Mapping[str, Proposals]) -> None:
    """Take up what the detector found next, by camera; all cameras' at once: a segment is judged with all."""
    works = dict(editor.labelling.works)
    for camera, part in parts.items():
        works[camera] = replace(works[camera], proposals=joined_proposals(works[camera].proposals, part))
    editor.labelling = replace(editor.labelling, works=works)


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


def _wanted(now: Labelling, listed: tuple[int, ...]) -> list[QueueItem]:
    """The listed moments without a label in this camera, by time; each is the nearest time that can be labelled."""
    times = sorted({now.grid.nearest(t_us) for t_us in listed if t_us < now.recording.duration_us})
    return [QueueItem(t_us, math.inf, LISTED) for t_us in times if t_us not in now.here.labels]


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
