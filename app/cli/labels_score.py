"""`rallyscope labels score`: a detector against labels, of one recording or of several."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from app.cli.arguments import DATA, PositiveInt, flag, positional
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.detector_arguments import MethodArguments
from app.cli.labels_layer import LayerArguments, read_layer
from app.cli.progress import progress_bar
from app.cli.streaming import StreamingArguments
from app.formatting import share_text
from app.modes.label.sources import LabelSource
from core.detection import DetectorConfig, make_detector
from core.detection.methods import Method
from core.errors import CommandError
from core.jobs import TaskControl, open_jobs
from core.metrics import WindowAnswers
from core.metrics.at_times import answers_at
from core.metrics.run import TimedDetector, one_opencv_thread
from core.recordings import open_recording
from core.text import counted
from labels.agreement import Agreement, measure_agreement
from labels.arrays import STATES, LabelArrays
from labels.formats.exchange import write_text
from labels.model import LabelState
from labels.score import GroupScore, InTime, answers_in_time, pooled, score_groups
from labels.score_picture import measure_curves, score_svg
from labels.store import LabelStore, Layer, has_labels

SHOWN_AT: Final = 1
"""Row of TOLERANCES_PX that the line of one recording of several shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelScoreArguments:
    """Score a detector against labels."""

    recordings: tuple[Path, ...] = positional("recordings that were labelled", "REC")
    camera: str | None = flag("which camera; needed if there are several", "NAME")
    annotator: str | None = flag("whose labels; needed if there are several", "NAME")
    data: Path = flag("workspace", "DIR", DATA)
    json: bool = flag("print the result as JSON")
    detector: MethodArguments
    window_us: PositiveInt | None = flag("length of a window", "N", "the config's")
    in_time: StreamingArguments
    picture: Path | None = flag("draw precision, recall and errors into a picture", "FILE.svg")
    engine: SharedBackendArguments

    def layer(self, recording: Path) -> LayerArguments:
        """The labels that are meant of one of them."""
        return LayerArguments(
            recording=recording, camera=self.camera, annotator=self.annotator, data=self.data, json=self.json
        )


@dataclass(frozen=True, slots=True, eq=False)
class LabelledRecording:
    """What is asked of one recording: a piece of work."""

    path: Path
    camera: str
    annotator: str
    count: int
    """Number of all labels; occluded balls are not counted."""
    asked: LabelArrays
    noise: Agreement | None
    """The annotator's own, from the blind repeats."""

    def __str__(self) -> str:
        return str(self.path)


@dataclass(frozen=True, slots=True, eq=False)
class LabelAnswers:
    """What a detector says at the labels of a recording."""

    own_time: WindowAnswers
    """Answers about the balls at the labels' own times."""
    in_time: InTime | None
    """The newest answers that have arrived by then; None if nobody asked."""


@dataclass(frozen=True, slots=True)
class AnswerLabels:
    """What a detector says at the labels of a recording."""

    method: Method
    config: DetectorConfig
    window_us: int
    added_us: int | None
    """Delay besides computing, for a score in time; None without one."""

    def __call__(self, piece: LabelledRecording, control: TaskControl) -> LabelAnswers:
        """Detect where there are labels."""
        with closing(open_recording(piece.path)) as recording:
            stream = recording.cameras[piece.camera]
            detector = TimedDetector(make_detector(self.method, stream.sensor, self.config))
            with one_opencv_thread() if self.added_us is not None else nullcontext():
                answers = answers_at(stream, detector, piece.asked.t_us, self.window_us, progress=control)
                if self.added_us is None:
                    return LabelAnswers(answers, None)
                in_time = answers_in_time(stream, detector, answers, self.window_us, self.added_us)
                return LabelAnswers(answers, in_time)


def run_score(arguments: LabelScoreArguments) -> None:
    """Read the labels here, detect wherever the engine says, and compare."""
    paths, (method, config) = arguments.recordings, arguments.detector.settings()
    added_us = arguments.in_time.added_us()
    work = AnswerLabels(method, config, arguments.window_us or config.window.window_us, added_us)
    with open_jobs(arguments.engine.engine(), len(paths)) as jobs, progress_bar("Scoring") as progress:
        pieces = [_piece(arguments.layer(path), jobs.share_file(path)) for path in paths]
        answers = jobs.run(work, pieces, name=str, progress=progress)
    scores = [score_groups(found.own_time, piece.asked) for found, piece in zip(answers, pieces, strict=True)]
    # All labels in one score: a mean of scores would give a short recording the weight of a long one.
    together, labels = pooled([(found.own_time, piece.asked) for found, piece in zip(answers, pieces, strict=True)])
    if arguments.picture is not None:
        title, noise_px = _title(work, pieces)
        write_text(arguments.picture, score_svg(measure_curves(together, labels), title, noise_px=noise_px))
    reports = [_report(work, *each) for each in zip(pieces, scores, answers, strict=True)]
    layer = arguments.layer(paths[0])
    if len(paths) == 1:
        lines = [*_score_table(scores[0]), _noise_line(pieces[0].noise), *_lines_in_time(pieces, answers)]
        layer.tell(reports[0], lines)
        return
    everything = score_groups(together, labels)
    named = [{"recording": str(path)} | report for path, report in zip(paths, reports, strict=True)]
    as_json = {"method": work.method, "window_us": work.window_us, "recordings": named}
    as_json["rows"] = [asdict(score) for score in everything]
    lines = [_line(*each) for each in zip(paths, pieces, scores, strict=True)]
    lines += [f"all {len(paths)} recordings", *_score_table(everything), *_lines_in_time(pieces, answers)]
    layer.tell(as_json, lines)


def _lines_in_time(pieces: Sequence[LabelledRecording], answers: Sequence[LabelAnswers]) -> list[str]:
    """A table of the newest answers, held and moved on, over all recordings; nothing where nobody asked."""
    found = [(one.in_time, piece.asked) for one, piece in zip(answers, pieces, strict=True) if one.in_time is not None]
    if not found:
        return []
    lines = []
    for title, each in (
        ("as given", [(one.held, asked) for one, asked in found]),
        ("extrapolated with the ball's velocity", [(one.moved, asked) for one, asked in found]),
    ):
        delays_ms = " and ".join(sorted({f"{1e-3 * one.delay_us:.2f}" for one, _ in found}))
        lines += [
            f"newest answers, {delays_ms} ms after the light, {title}",
            *_score_table(score_groups(*pooled(each))),
        ]
    return lines


def _piece(arguments: LayerArguments, path: Path) -> LabelledRecording:
    """The labels of a recording; raises CommandError for frames, and if there are none."""
    with arguments.open() as (recording, stream):
        if isinstance(stream, LabelSource):
            raise CommandError("the detector works on events", got=f"the frames of {stream.name!r}", where="--camera")
        store = read_layer(arguments, recording, stream)
        labels = store.labels()
    asked = labels.rows(labels.state != STATES.index(LabelState.OCCLUDED))
    return LabelledRecording(
        path, stream.name, store.layer.annotator, len(labels), asked, _own_noise(arguments.folder, store)
    )


def _report(
    work: AnswerLabels, piece: LabelledRecording, scores: tuple[GroupScore, ...], answers: LabelAnswers
) -> dict[str, object]:
    in_time: dict[str, object] = {}
    if answers.in_time is not None:
        rows = {
            name: [asdict(score) for score in score_groups(found, piece.asked)]
            for name, found in (("held", answers.in_time.held), ("moved", answers.in_time.moved))
        }
        in_time = {"streaming": {"delay_us": answers.in_time.delay_us, **rows}}
    return {
        "annotator": piece.annotator,
        "method": work.method,
        "window_us": work.window_us,
        "rows": [asdict(score) for score in scores],
        "annotator_noise": None if piece.noise is None else _noise_json(piece.noise),
        **in_time,
    }


def _title(work: AnswerLabels, pieces: Sequence[LabelledRecording]) -> tuple[str, float | None]:
    """Words over the picture, and the annotator's own noise in pixels where it is that of all labels."""
    count, first = sum(piece.count for piece in pieces), pieces[0]
    if len(pieces) > 1:
        return f"{work.method}, against {counted(count, 'label')} of {counted(len(pieces), 'recording')}", None
    noise_px = None if first.noise is None or not first.noise.by_hand.pairs else first.noise.by_hand.sigma_px
    return f"{work.method}, {first.camera}, against {counted(count, 'label')} by {first.annotator}", noise_px


def _line(path: Path, piece: LabelledRecording, scores: tuple[GroupScore, ...]) -> str:
    """One recording of several."""
    if not scores:
        return f"{path}: no label that can be asked for"
    score, at = scores[0], scores[0].at[SHOWN_AT]
    return (
        f"{path}: labels {score.labels} by {piece.annotator}, balls {score.with_ball}, "
        f"F1 {share_text(at.f1)} at {at.tolerance_px:g} px, median {score.median_px:.2f} px"
    )


def _own_noise(folder: Path, store: LabelStore) -> Agreement | None:
    layer = Layer(store.layer.recording_uuid, store.layer.camera, store.layer.annotator, blind=True)
    if not has_labels(folder, layer):
        return None
    return measure_agreement(*(one.independent().labels for one in (store, LabelStore.read(folder, layer))))


def _noise_json(noise: Agreement) -> dict[str, object]:
    """Agreement over all pairs; `labels agree` has it by how each pair came about."""
    return {key: value for key, value in asdict(noise).items() if key != "by_source"}


def _score_table(scores: tuple[GroupScore, ...]) -> list[str]:
    lines = ["labels         number  balls   P / R / F1 at 1, 2, 4, 8 px" + " " * 44 + "median   p95  along across px"]
    for score in scores:
        at = "   ".join("/".join(map(share_text, (row.precision, row.recall, row.f1))) for row in score.at)
        errors = f"{score.median_px:6.2f} {score.p95_px:6.2f} {score.along_px:+6.2f} {score.across_px:+6.2f}"
        lines.append(f"{score.group:<13} {score.labels:7d} {score.with_ball:6d}   {at}  {errors}")
    return lines


def _noise_line(noise: Agreement | None) -> str:
    if noise is None or not noise.both_seen:
        return "annotator noise: not measured, no blind repeats yet"
    hand = noise.by_hand
    if not hand.pairs:
        return f"annotator noise: not measured, none of {noise.both_seen} blind repeats was by hand both times"
    return f"annotator noise: median {hand.median_px:.2f} px, p95 {hand.p95_px:.2f} px between two looks"
