"""Selected balls as a data set: each flight is cut out of its recording, with the ball's centres by labels or truth."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.export.frozen import freeze, write_frozen
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, check_cancelled, unfinished_file
from app.shared.ball_index import BallIndex
from core.data_sets.card import Json, write_documents
from core.data_sets.cut_flights import CutFlight, flights_card, flights_manifest, splits_text
from core.data_sets.facts import RecordingFacts, count_facts
from core.errors import CommandError
from core.recordings import open_recording
from core.recordings.reader import FileRecording
from core.text import counted
from labels.arrays import LabelArrays, label_arrays
from labels.balls.flights import TRUTH, Flight, FlightCentres, centres_in, flights_of
from labels.database.folder import store_path
from labels.store_contents import read_store

CUT: Final = "flight"
"""Where the config of a cut recording says where it is from."""
CENTRES_BY: Final = "centres_by"
"""And who says where the ball is in its cameras."""
IN_RUN: Final = "balls of training runs, which have no events"
UNKNOWN: Final = "flights without labels and without truth"
AGAIN: Final = "flights that are there already, by a copy of their recording"
OTHERS: Final = "labels of annotators who labelled less of a flight than another one"
_NAMESPACE: Final = uuid.UUID("0c5b0b0e-6d8f-4f0b-9a55-7d1d1f3f3b49")


@dataclass(frozen=True, slots=True)
class FlightSet:
    """A data set that was written."""

    folder: Path
    manifest: Json

    def __str__(self) -> str:
        """What was done, in a line."""
        selection, total = self.manifest["selection"], self.manifest["total"]
        assert isinstance(selection, dict) and isinstance(total, dict)
        flights, centres = counted(total["recordings"], "flight"), counted(total["centres_2d"], "centre")
        done = f"{flights} ({splits_text(selection['splits'])}), {centres}: {self.folder}"
        return f"{done}; {left_out_text(selection['left_out'])}" if selection["left_out"] else done


def left_out_text(left_out: Mapping[str, int]) -> str:
    """What was left out, in words."""
    return "left out: " + ", ".join(f"{count:,} {reason}" for reason, count in left_out.items())


def write_flight_set(
    index: BallIndex,
    rows: NDArray[np.int64],
    labels_folder: Path,
    folder: Path,
    *,
    selected_by: str,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> FlightSet:
    """Write the flights of these rows as a data set: a recording each, the index and the card.

    Args:
        index: the balls.
        rows: of it; a bounce, a stroke or a net touch stands for its flight.
        labels_folder: of a workspace; without labels of the ball in a flight its recording's truth is used.
        folder: of the data set; it appears when all is written.
        selected_by: conditions or lasso, in words, for the card.
        progress: gets the share that is done.
        cancelled: looked at between slices of events.

    Raises:
        CommandError: if the folder exists, cannot be written, or nothing is left to write.
        RecordingError: if a recording is gone.
        LabelError: if labels cannot be read.
        ExportCancelledError: if `cancelled()` is true; nothing is left behind then.
    """
    if folder.exists():
        raise CommandError("exists already", where=folder, remedy="take another name")
    sources = np.searchsorted(index.first_rows, rows, side="right") - 1
    with unfinished_file(folder, overwrite=True) as partial:
        partial.mkdir()
        writer = _Writer(partial, labels_folder, cancelled)
        numbers = np.unique(sources)
        for number, source in enumerate(numbers.tolist()):
            check_cancelled(cancelled)
            chosen = rows[sources == source] - index.first_rows[source]

            def part(share: float, number: int = number) -> None:
                progress((number + share) / len(numbers))

            writer.add(index, source, chosen, part)
        if not writer.made:
            raise CommandError(
                "no flight to write",
                expected="flights in which the ball is labelled, or with the truth of a simulation",
                got=left_out_text(writer.left_out) if writer.left_out else "no ball",
                remedy="label the ball in them, or select others",
            )
        manifest = flights_manifest(folder.name, selected_by, writer.made, writer.left_out)
        write_documents(partial, manifest, flights_card(manifest))
    return FlightSet(folder, manifest)


class _Writer:
    """Writes the flights of one recording after the other into a folder."""

    def __init__(self, folder: Path, labels_folder: Path, cancelled: Cancelled) -> None:
        self._folder, self._labels, self._cancelled = folder, labels_folder, cancelled
        self.made: list[tuple[CutFlight, RecordingFacts]] = []
        self.left_out: Counter[str] = Counter()
        self._spans: dict[str, list[Span]] = {}
        """What is written of each recording, by uuid."""

    def add(self, index: BallIndex, source: int, chosen: NDArray[np.int64], progress: Progress) -> None:
        """Write the flights of these rows of a source."""
        about = index.sources[source]
        if about.kind == "run":
            self.left_out[IN_RUN] += len(chosen)
            return
        first, end = index.first_rows[source : source + 2].tolist()
        with closing(open_recording(about.path)) as recording:
            labels, contacts_us = _labels(self._labels, recording.uuid)
            flights, without = flights_of(index.table.slice(first, end - first), chosen.tolist(), contacts_us)
            self.left_out.update(without)
            for number, flight in enumerate(flights):
                check_cancelled(self._cancelled)

                def part(share: float, number: int = number) -> None:
                    progress((number + share) / len(flights))

                self._add_flight(about.name, recording, flight, labels, part)

    def _add_flight(
        self,
        name: str,
        recording: FileRecording,
        flight: Flight,
        labels: Mapping[str, Mapping[str, LabelArrays]],
        progress: Progress,
    ) -> None:
        span = Span(flight.start_us, min(flight.end_us, recording.duration_us))
        centres = {
            camera: found
            for camera, stream in recording.cameras.items()
            if (found := centres_in(flight, stream.truth, labels.get(camera, {}), _truth_by(recording, camera)))
        }
        if span.length_us <= 0 or not (centres or _ball_is_known(recording, span)):
            self.left_out[UNKNOWN] += 1
            return
        origin, start_us = _origin(recording, span)
        there = self._spans.setdefault(origin, [])
        if any(start_us < one.end_us and one.start_us < start_us + span.length_us for one in there):
            self.left_out[AGAIN] += 1
            return
        there.append(Span(start_us, start_us + span.length_us))
        if unused := sum(one.unused for one in centres.values()):
            self.left_out[OTHERS] += unused
        cut = CutFlight(
            recording=name,
            recording_uuid=origin,
            ball=flight.ball,
            start_us=start_us,
            end_us=start_us + span.length_us,
            found_by=flight.method,
            centres_by={camera: one.who for camera, one in centres.items()},
            label_sources=dict(sum((Counter(one.label_sources) for one in centres.values()), Counter())),
            speed_mps=flight.speed_mps,
            sensor=", ".join(sorted({str(stream.sensor) for stream in recording.cameras.values()})),
        )
        path = self._folder / f"flight-{len(self.made) + 1:04d}.h5"
        self._write(path, recording, span, cut, centres, progress)
        self.made.append((cut, count_facts(path, path.stem)))

    def _write(
        self,
        path: Path,
        recording: FileRecording,
        span: Span,
        cut: CutFlight,
        centres: Mapping[str, FlightCentres],
        progress: Progress,
    ) -> None:
        frozen = freeze(recording, span)
        streams = {
            name: replace(stream, truth=centres[name].truth if name in centres else None)
            for name, stream in frozen.streams.items()
        }
        write_frozen(
            replace(frozen, streams=streams),
            span,
            path,
            progress=progress,
            cancelled=self._cancelled,
            config={
                "source": "a flight of a recording",
                CUT: {"recording_uuid": cut.recording_uuid, "start_us": cut.start_us, "end_us": cut.end_us},
                CENTRES_BY: dict(cut.centres_by),
            },
            # The same flight is the same recording in every data set: labels of it fit.
            uuid=str(uuid.uuid5(_NAMESPACE, f"{cut.recording_uuid} {cut.start_us} {cut.end_us}")),
        )


def _origin(recording: FileRecording, span: Span) -> tuple[str, int]:
    """The recording that the events of a span were first in, and its start there: a cut one names what it was cut of.

    So a flight and its copy in a data set are one, and do not come into two splits.
    """
    cut = (recording.config or {}).get(CUT)
    if isinstance(cut, dict):
        origin, start_us = cut.get("recording_uuid"), cut.get("start_us")
        if isinstance(origin, str) and isinstance(start_us, int) and 0 <= start_us < 2**62:
            return origin, start_us + span.start_us
    return recording.uuid, span.start_us


def _truth_by(recording: FileRecording, camera: str) -> str:
    """Whose a camera's truth is: in a recording that was cut out it may be of labels."""
    by = (recording.config or {}).get(CENTRES_BY)
    who = by.get(camera) if isinstance(by, dict) else None
    return who if isinstance(who, str) else TRUTH


def _ball_is_known(recording: FileRecording, span: Span) -> bool:
    ball = recording.ball
    return ball is not None and bool(ball.visible[(ball.t_us >= span.start_us) & (ball.t_us < span.end_us)].any())


def _labels(folder: Path, recording_uuid: str) -> tuple[dict[str, dict[str, LabelArrays]], list[int]]:
    """Labels of a recording by camera and annotator, and times of labelled contacts; second looks are left to agree."""
    path, found, contacts_us = store_path(folder, recording_uuid), {}, []
    if path.is_file():
        contents = read_store(path)
        for layer, labels in contents.layers.items():
            if not layer.blind:
                found.setdefault(layer.camera, {})[layer.annotator] = label_arrays(labels.values())
                contacts_us += [one.t_us for one in contents.contacts[layer]]
    return found, contacts_us
