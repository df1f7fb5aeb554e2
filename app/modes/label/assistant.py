"""Help that takes its time: the detector that proposes, the queue of what is suspicious, second looks."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.background.jobs import Job
from app.background.worker import LatestWins
from app.modes.label.commands.assisted import AddProposals
from app.modes.label.commands.cursor import BeginSecondLook, GoTo
from app.modes.label.commands.flight import TakeFlight
from app.modes.label.commands.step import Note
from app.modes.label.editor import LabelEditor
from app.modes.label.label_writer import LayerKey, Saved
from app.modes.label.plan import CameraWork
from core.cameras import Camera
from core.detection.saved import SavedDetector
from core.recordings import CameraStream
from labels.arrays import LabelArrays
from labels.assist import Proposals, WholeFlight, check_labels, next_blind, propose, review_queue, whole_flight
from labels.assist.review import QueueItem
from labels.model import Label
from labels.score import LEAD_IN_US
from labels.store import LabelStore

CHUNK_US: Final = 100_000
SHORTEST_CHUNK_US: Final = 20_000
"""In a short recording: each chunk is handed over by itself, and tells how far the detector is."""

Ask = Callable[[], tuple[str, tuple[QueueItem, ...]]]


class LabelSuggestions:
    """Helps with one browser's labelling. Methods are called by the loop."""

    def __init__(self, editor: LabelEditor, pool: Executor) -> None:
        self._editor = editor
        self._job: Job[None] | None = None
        self._reached_us = 0
        """The detector that runs has handed over everything before this time."""
        self._visited: set[tuple[str, int]] = set()
        self.queue: tuple[QueueItem, ...] = ()
        """What is suspicious, as it was found last."""
        self.reason = ""
        """Why the cursor was sent here."""
        self.reason_us = -1
        self._doubted: Label | None = None
        """The label that it speaks of."""
        self._queue_work = LatestWins(pool, _answer, self._queue_done, editor.failed)
        self._flight_work = LatestWins(pool, _find_flight, self._flight_done, editor.failed)

    @property
    def share(self) -> float | None:
        """How much of the recording the detector has been through since its start; None: it is not running."""
        return None if self._job is None else self._job.share

    def reason_for(self, label: Label | None) -> str:
        """Why the cursor was sent to where it is now; nothing once the label there is another one."""
        here = self.reason_us == self._editor.labelling.t_us and label == self._doubted
        return self.reason if here else ""

    def _give_reason(self, reason: str, t_us: int) -> None:
        self.reason, self.reason_us = reason, t_us
        self._doubted = self._editor.labelling.here.labels.get(t_us)

    def close(self) -> None:
        """The browser or the recording is gone."""
        self._queue_work.close()
        self._flight_work.close()
        if self._job is not None:
            self._job.cancel()

    # Proposals ----------------------------------------------------------------------------------------------------

    def toggle_propose(self, detector: SavedDetector) -> None:
        """Run the detector from the cursor to the end, in both cameras; or stop it."""
        if self._job is not None:
            self._job.cancel()
            self._job = None
            return
        labelling, callbacks = self._editor.labelling, self._editor.callbacks
        sources = (labelling.source, labelling.partner)
        streams = [source.stream for source in sources if source is not None and source.stream is not None]
        if not streams:
            callbacks.note(Note("No proposals here", "The detector works on events, not on frames.", "yellow"))
            return
        # From a little before the cursor: what is proposed there is judged by its neighbours on both sides.
        window_us = detector.config.window.window_us
        start_us = self._reached_us = max(labelling.t_us - LEAD_IN_US, 0) // window_us * window_us
        end_us = labelling.recording.duration_us
        job: Job[None] = Job(
            lambda progress, cancelled: self._propose(streams, start_us, end_us, detector, progress, cancelled),
            lambda _: callbacks.later(self._job_done),
            lambda error: callbacks.later(lambda: self._job_failed(error)),
        )
        self._job = job

    def _propose(
        self,
        streams: list[CameraStream],
        start_us: int,
        end_us: int,
        detector: SavedDetector,
        progress: Callable[[float], None],
        cancelled: Callable[[], bool],
    ) -> None:
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
            self._editor.callbacks.later(
                lambda parts=parts, t_us=reached_us: None if cancelled() else self._take(parts, t_us)
            )
            progress(min((reached_us - start_us) / span_us, 1.0))

    def _take(self, parts: dict[str, Proposals], reached_us: int) -> None:
        self._editor.send(AddProposals(parts))
        self._reached_us = reached_us

    def _job_done(self) -> None:
        self._job = None

    def _job_failed(self, error: Exception) -> None:
        self._job = None
        self._editor.callbacks.report(error)

    @property
    def segment_due(self) -> bool:
        """What is proposed round the cursor is on the screen, as far as the detector will find anything there."""
        labelling = self._editor.labelling
        finding = self._job is not None and self._reached_us <= labelling.t_us + LEAD_IN_US
        return labelling.view.blind or (labelling.on_screen and not finding)

    # Whole flights ------------------------------------------------------------------------------------------------

    def take_flight(self) -> None:
        """Accept every proposal of the flight round the cursor, in both cameras; go to what is doubted."""
        now, note = self._editor.labelling, self._editor.callbacks.note
        if not now.on_screen or now.view.blind:
            return
        if now.calibrations is None or now.there is None:
            text = "A flight needs two calibrated cameras; Enter accepts what is steady in one."
            note(Note("No flight here", text, "yellow"))
        elif now.here.proposals is None or now.there.proposals is None:
            note(Note("No proposals here", "I runs the detector from the cursor on.", "yellow"))
        else:
            pair = now.here.proposals, now.there.proposals
            self._flight_work.submit(FlightAsk(now.view.camera, now.calibrations, pair, now.t_us))

    def _flight_done(self, ask: FlightAsk, found: WholeFlight | None) -> None:
        self._editor.callbacks.later(lambda: self._take_flight(ask, found))

    def _take_flight(self, ask: FlightAsk, found: WholeFlight | None) -> None:
        now = self._editor.labelling
        if (ask.camera, ask.t_us) != (now.view.camera, now.t_us):
            return  # the person went elsewhere
        if found is None:
            text = "What is proposed round here in both cameras is not one ball in free flight."
            self._editor.callbacks.note(Note("No flight here", text, "yellow"))
            return
        take = TakeFlight(found)
        doubted_us = take.doubted_us(now)
        if doubted_us:
            self._give_reason(take.reason(doubted_us[0]), doubted_us[0])
        self._editor.send(take)

    # The queue ----------------------------------------------------------------------------------------------------

    def next_suspicious(self) -> None:
        """Work out what is suspicious, and go to the worst that was not visited yet."""
        now = self._editor.labelling
        there = None if now.there is None else now.there.arrays
        self._queue_work.submit(lambda: (now.view.camera, _queue(now.here, there, now.calibrations, now.grid.times())))

    def _queue_done(self, ask: Ask, answer: tuple[str, tuple[QueueItem, ...]]) -> None:
        self._editor.callbacks.later(lambda: self._go_to_worst(*answer))

    def _go_to_worst(self, camera: str, items: tuple[QueueItem, ...]) -> None:
        if camera != self._editor.labelling.view.camera:
            return
        left = tuple(item for item in items if (camera, item.t_us) not in self._visited)
        if not left:
            self._visited.clear()
            text = "Every item was visited; the next press begins anew." if items else "Nothing speaks against a label."
            self._editor.callbacks.note(Note("Queue", text, "green"))
            self.queue = ()
            return
        item, self.queue = left[0], left
        self._visited.add((camera, item.t_us))
        self._give_reason(item.reason, item.t_us)
        self._editor.send(GoTo(item.t_us))

    # Second looks -------------------------------------------------------------------------------------------------

    def second_look(self) -> None:
        """Ask for a label again, without showing it."""
        editor, now = self._editor, self._editor.labelling
        if now.view.blind:
            return
        picked: list[int] = []

        def act(second: LabelStore) -> tuple[int, ...]:
            t_us = next_blind(editor.writer.store(now.layer), second, recent_us=now.recent_us)
            picked.extend([] if t_us is None else [t_us])
            return ()

        def done(_: Saved) -> None:
            editor.callbacks.later(lambda: self._begin_second_look(picked))

        editor.writer.act(LayerKey(now.view.camera, now.view.annotator, blind=True), act, done, editor.failed)

    def _begin_second_look(self, picked: list[int]) -> None:
        if picked:
            self._editor.send(BeginSecondLook(picked[0]))
        else:
            text = "One label in twenty is asked for again, once twenty others were made after it."
            self._editor.callbacks.note(Note("No second look is due", text, "green"))


@dataclass(frozen=True, slots=True, eq=False)
class FlightAsk:
    """Where a flight is looked for, and in what."""

    camera: str
    cameras: tuple[Camera, Camera]
    proposals: tuple[Proposals, Proposals]
    t_us: int


def _find_flight(ask: FlightAsk) -> WholeFlight | None:
    return whole_flight(ask.cameras, ask.proposals, ask.t_us)


def _answer(ask: Ask) -> tuple[str, tuple[QueueItem, ...]]:
    return ask()


def _queue(
    here: CameraWork, there: LabelArrays | None, cameras: tuple[Camera, Camera] | None, frames_us: NDArray[np.int64]
) -> tuple[QueueItem, ...]:
    residual = None
    if cameras is not None and there is not None and len(there) and len(here.arrays):
        residual = check_labels(cameras[0], here.arrays, cameras[1], there).residual_px
    rejected_us = tuple(t_us for t_us, _ in here.rejected)
    return review_queue(
        here.arrays,
        proposals=here.proposals,
        stereo_residual_px=residual,
        frames_us=frames_us,
        rejected_us=rejected_us,
    )
