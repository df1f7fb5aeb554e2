"""Help for the person who labels: proposals of the detector, whole segments, interpolation, the queue, second looks."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.background.jobs import Job
from app.background.worker import LatestWins
from app.modes.label.label_changes import accepted, proposed_at
from app.modes.label.label_writer import LayerName, Saved
from app.modes.label.plan import CameraWork
from app.modes.label.work import LabelWork
from core.cameras import Camera
from core.detection import DetectorConfig
from core.recordings import CameraStream
from labels.arrays import LabelArrays
from labels.assist import (
    Proposals,
    check_labels,
    check_stereo,
    curve_of_flight,
    fit_flight,
    interpolate,
    labels_from_curve,
    next_blind,
    propose,
    review_queue,
    steady_segment,
)
from labels.assist.curve import Curve
from labels.assist.propose import joined_proposals
from labels.assist.review import QueueItem
from labels.model import Label
from labels.store import LabelStore

CHUNK_US: Final = 100_000
LEAD_IN_US: Final = 20_000
"""The detector sees so much before each part, to lock on."""
SEGMENT_US: Final = 2_000_000
"""Interpolation looks so far round the cursor."""

Ask = Callable[[], tuple[str, tuple[QueueItem, ...]]]


class Assistant:
    """Helps with one browser's work. Methods are called by the loop."""

    def __init__(self, work: LabelWork, pool: Executor) -> None:
        self._work = work
        self._job: Job[None] | None = None
        self._reached_us = 0
        """The detector that runs has handed over everything before this time."""
        self._visited: set[tuple[str, int]] = set()
        self.queue: tuple[QueueItem, ...] = ()
        """What is suspicious, as it was found last."""
        self.reason = ""
        """Why the cursor was sent here."""
        self.reason_us = -1
        self._queue_work = LatestWins(pool, _answer, self._queue_done, self._later_failed)

    @property
    def share(self) -> float | None:
        """How much of the recording the detector has been through since its start; None: it is not running."""
        return None if self._job is None else self._job.share

    def close(self) -> None:
        """The browser or the recording is gone."""
        self._queue_work.close()
        if self._job is not None:
            self._job.cancel()

    # Proposals ----------------------------------------------------------------------------------------------------

    def toggle_propose(self, config: DetectorConfig) -> None:
        """Run the detector from the cursor to the end, in both cameras; or stop it."""
        if self._job is not None:
            self._job.cancel()
            self._job = None
            return
        work = self._work
        names = [work.view.camera] + ([work.partner.name] if work.partner is not None else [])
        streams = [stream for name in names if (stream := work.sources[name].stream) is not None]
        if not streams:
            work.hooks.note("No proposals here", "The detector works on events, not on frames.", "yellow")
            return
        # From a little before the cursor: what is proposed there is judged by its neighbours on both sides.
        window_us = config.window.window_us
        start_us = self._reached_us = max(work.t_us - LEAD_IN_US, 0) // window_us * window_us
        end_us = work.recording.duration_us
        job: Job[None] = Job(
            lambda progress, cancelled: self._propose(streams, start_us, end_us, config, progress, cancelled),
            lambda _: work.hooks.later(self._job_done),
            lambda error: work.hooks.later(lambda: self._job_failed(error)),
        )
        self._job = job

    def _propose(
        self,
        streams: list[CameraStream],
        start_us: int,
        end_us: int,
        config: DetectorConfig,
        progress: Callable[[float], None],
        cancelled: Callable[[], bool],
    ) -> None:
        window_us = config.window.window_us
        for begin_us in range(start_us, end_us, CHUNK_US):
            reached_us, parts = begin_us + CHUNK_US, {}
            lead_us = max(begin_us - LEAD_IN_US // window_us * window_us, 0)
            for stream in streams:
                if cancelled():
                    return
                found = propose(stream, lead_us, min(reached_us, end_us), config=config)
                parts[stream.name] = found.between(begin_us, reached_us + 1)
            self._work.hooks.later(
                lambda parts=parts, t_us=reached_us: None if cancelled() else self._take(parts, t_us)
            )
            progress(min((reached_us - start_us) / max(end_us - start_us, 1), 1.0))

    def _take(self, parts: dict[str, Proposals], reached_us: int) -> None:
        """Both cameras' at once: a segment is never accepted without the other camera because that came later."""
        works = self._work.works
        for camera, part in parts.items():
            works[camera] = replace(works[camera], proposals=joined_proposals(works[camera].proposals, part))
        self._reached_us = reached_us

    def _job_done(self) -> None:
        self._job = None

    def _job_failed(self, error: Exception) -> None:
        self._job = None
        self._work.hooks.report(error)

    @property
    def segment_due(self) -> bool:
        """What is proposed round the cursor is on the screen, as far as the detector will find anything there."""
        work = self._work
        finding = self._job is not None and self._reached_us <= work.t_us + LEAD_IN_US
        return work.view.blind or (work.on_screen and not finding)

    def accept_segment(self) -> None:
        """Accept every proposal round here that its neighbours and the other camera bear out, as one step of undo."""
        work, here = self._work, self._work.here
        if not work.on_screen or work.view.blind:
            return
        if here.proposals is None:
            work.hooks.note("No proposals here", "I runs the detector from the cursor on.", "yellow")
            return
        residual = self._stereo_of(here.proposals)
        rows = steady_segment(here.proposals, work.t_us, stereo_residual_px=residual)
        if not len(rows):
            work.hooks.note("Not at once", "The proposals round here do not agree with each other.", "yellow")
            return
        first_us, last_us = here.proposals.t_us[rows[[0, -1]]].tolist()
        times = [t for t in work.grid.times().tolist() if first_us <= t <= last_us]
        shown_picture = work.shown_picture()
        drafts = [
            draft
            for t in times
            if t not in here.labels and t not in here.rejected and (draft := proposed_at(here.proposals, t)) is not None
        ]
        labels = tuple(accepted(draft, replace(shown_picture, t_us=draft.t_us, time_spent_ms=0)) for draft in drafts)

        def act(store: LabelStore) -> tuple[int, ...]:
            new = tuple(label for label in labels if store.at(label.t_us) is None)
            store.edit(put=new)
            return tuple(label.t_us for label in new)

        work.carry_out(act)
        work.decisions += len(labels) - 1
        work.hooks.note("Segment accepted", f"{len(labels)} labels; Z takes them all back", "green")
        work.go(work.grid.moved(last_us, +1))

    def _stereo_of(self, proposals: Proposals) -> NDArray[np.float64] | None:
        partner = self._work.partner
        there = None if partner is None else self._work.works[partner.name].proposals
        cameras = self._cameras()
        if there is None or cameras is None:
            return None
        other = there.at(proposals.t_us)
        here_px = np.column_stack([proposals.x_px, proposals.y_px])
        return check_stereo(cameras[0], here_px, cameras[1], np.column_stack([other.x_px, other.y_px])).residual_px

    def _cameras(self) -> tuple[Camera, Camera] | None:
        partner = self._work.partner
        if partner is None or self._work.source.calibration is None or partner.calibration is None:
            return None
        return self._work.source.calibration, partner.calibration

    # Interpolation ------------------------------------------------------------------------------------------------

    def interpolate(self) -> None:
        """Label the unchecked times between labels round here: by a flight in 3D if one fits, else by a curve."""
        work, t_us = self._work, self._work.t_us
        times = work.grid.times()
        times = times[(times >= t_us - SEGMENT_US) & (times <= t_us + SEGMENT_US)]
        there = None if work.partner is None else work.works[work.partner.name].arrays
        cameras, breaks = self._cameras(), work.breaks_us

        def act(store: LabelStore) -> tuple[int, ...]:
            labels = _between(store.labels(), there, cameras, times, t_us, breaks)
            store.edit(put=labels)
            return tuple(label.t_us for label in labels)

        def done(saved: Saved) -> None:
            count = len(saved.touched_us)
            text = f"{count} labels; Z takes them back" if count else "It takes five labels without a break between."
            work.hooks.later(lambda: work.hooks.note("Interpolated", text, "green" if count else "yellow"))
            work.hooks.later(lambda: work.take(saved))

        work.desk.act(work.layer, act, done, self._later_failed)

    # The queue ----------------------------------------------------------------------------------------------------

    def next_suspicious(self) -> None:
        """Work out what is suspicious, and go to the worst that was not visited yet."""
        work, camera = self._work, self._work.view.camera
        here, cameras, frames = work.here, self._cameras(), work.grid.times()
        there = None if work.partner is None else work.works[work.partner.name].arrays
        self._queue_work.submit(lambda: (camera, _queue(here, there, cameras, frames)))

    def _queue_done(self, ask: Ask, answer: tuple[str, tuple[QueueItem, ...]]) -> None:
        self._work.hooks.later(lambda: self._go_to_worst(*answer))

    def _go_to_worst(self, camera: str, items: tuple[QueueItem, ...]) -> None:
        if camera != self._work.view.camera:
            return
        left = tuple(item for item in items if (camera, item.t_us) not in self._visited)
        if not left:
            self._visited.clear()
            text = "Every item was visited; the next press begins anew." if items else "Nothing speaks against a label."
            self._work.hooks.note("Queue", text, "green")
            self.queue = ()
            return
        item, self.queue = left[0], left
        self._visited.add((camera, item.t_us))
        self.reason, self.reason_us = item.reason, item.t_us
        self._work.go(item.t_us)

    # Second looks -------------------------------------------------------------------------------------------------

    def second_look(self) -> None:
        """Ask for a label again, without showing it."""
        work = self._work
        if work.view.blind:
            return
        first = work.layer
        recent, picked = list(work.recent_us), []

        def act(second: LabelStore) -> tuple[int, ...]:
            t_us = next_blind(work.desk.store(first), second, recent_us=recent)
            picked.extend([] if t_us is None else [t_us])
            return ()

        def done(_: Saved) -> None:
            work.hooks.later(lambda: self._begin_second_look(picked))

        work.desk.act(LayerName(first.camera, first.annotator, blind=True), act, done, self._later_failed)

    def _begin_second_look(self, picked: list[int]) -> None:
        work = self._work
        if not picked:
            text = "One label in twenty is asked for again, once twenty others were made after it."
            work.hooks.note("No second look is due", text, "green")
            return
        work.back_us = work.t_us
        work.go(picked[0])
        work.change_view(blind=True)

    def leave_second_look(self) -> None:
        """Back, without an answer."""
        if self._work.view.blind:
            self._work.change_view(blind=False)
            self._work.go(self._work.back_us)

    def _later_failed(self, error: Exception) -> None:
        self._work.hooks.later(lambda: self._work.hooks.report(error))


def _answer(ask: Ask) -> tuple[str, tuple[QueueItem, ...]]:
    return ask()


def _between(
    keys: LabelArrays,
    there: LabelArrays | None,
    cameras: tuple[Camera, Camera] | None,
    times: NDArray[np.int64],
    t_us: int,
    breaks_us: tuple[int, ...],
) -> tuple[Label, ...]:
    """Labels for the unlabelled ones of these times in the segment that holds `t_us`."""
    plain = interpolate(keys, times, breaks_us=breaks_us)
    if not plain.covered.any():
        return ()
    nearest = int(np.flatnonzero(plain.covered)[np.argmin(np.abs(plain.t_us[plain.covered] - t_us))])
    inside = times[plain.segment == plain.segment[nearest]]
    curve, made_of = plain, "curve"
    if cameras is not None and there is not None:
        span = int(inside[0]) - 1, int(inside[-1]) + 2
        flight = fit_flight(cameras, (keys.between(*span), there.between(*span)))
        if flight is not None:
            curve, made_of = curve_of_flight(flight, cameras[0], times), "flight"
    free = np.isin(curve.t_us, inside) & ~np.isin(curve.t_us, keys.t_us) & curve.covered
    return labels_from_curve(_rows(curve, free), made_of=made_of)


def _rows(curve: Curve, rows: NDArray[np.bool_]) -> Curve:
    return Curve(
        curve.t_us[rows],
        curve.x_px[rows],
        curve.y_px[rows],
        curve.r_px[rows],
        curve.sigma_px[rows],
        curve.segment[rows],
    )


def _queue(
    here: CameraWork, there: LabelArrays | None, cameras: tuple[Camera, Camera] | None, frames_us: NDArray[np.int64]
) -> tuple[QueueItem, ...]:
    residual = None
    if cameras is not None and there is not None and len(there) and len(here.arrays):
        residual = check_labels(cameras[0], here.arrays, cameras[1], there).residual_px
    return review_queue(here.arrays, proposals=here.proposals, stereo_residual_px=residual, frames_us=frames_us)
