"""`rallyscope labels import|export|score|agree|merge`: exchange labels with other tools, and measure with them."""

from __future__ import annotations

import csv
import json
from collections.abc import Collection, Iterable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import asdict, dataclass
from importlib.metadata import version
from math import isnan
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from app.cli.arguments import DATA, PositiveInt, flag, positional
from app.cli.detect import choose_camera
from app.cli.detector_arguments import MethodArguments
from app.cli.labels_merge import run_merge
from app.cli.progress import progress_bar
from app.cli.tables import json_ready
from app.cli.terminal import say, say_each
from app.modes.label.results.label_files import LabelFilesRequest, write_label_files
from app.modes.label.sources import LabelSource, sources_of
from core.detection import make_detector
from core.errors import CommandError, LabelError
from core.recordings import CameraStream, Recording, open_recording
from labels.agreement import Agreement, made_independently, measure_agreement
from labels.arrays import STATES
from labels.formats import FORMATS, ExportOptions, ImportContext
from labels.formats.exchange import write_text
from labels.model import LabelState
from labels.score import GroupScore, answers_at, score_groups
from labels.score_picture import measure_curves, score_svg
from labels.store import LabelStore, Layer, find_layers, has_labels

Labelled = CameraStream | LabelSource
"""An event camera, or the frames of an ordinary one."""
MAX_SHOWN = 20
"""Rejections printed one by one; `--json` has them all."""


FORMAT_HELP = "; ".join(f"{name}: {item.summary}" for name, item in FORMATS.items())


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerArguments:
    """Which labels of what."""

    recording: Path = positional("the recording that was labelled", "REC")
    camera: str | None = flag("which camera; needed if there are several", "NAME")
    annotator: str | None = flag("whose labels; needed if there are several", "NAME")
    data: Path = flag("workspace", "DIR", DATA)
    json: bool = flag("print the result as JSON")

    @property
    def folder(self) -> Path:
        """Where the labels are."""
        return self.data / "labels"

    @contextmanager
    def open(self) -> Iterator[tuple[Recording, Labelled]]:
        """The recording and what was labelled of it, until the block ends."""
        with closing(open_recording(self.recording)) as recording:
            frames = sources_of(recording).get(self.camera or "")
            stream = frames if frames is not None and frames.frames is not None else None
            yield recording, stream or choose_camera(recording, self.camera)

    def tell(self, report: dict[str, object], lines: Iterable[str]) -> None:
        """What came out, for a program or a person."""
        if self.json:
            say(json.dumps(json_ready(report)))
        else:
            say_each(lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelImportArguments:
    """Take labels from files of another tool."""

    source: Path = positional("a file, or a folder of files", "SRC")
    layer: LayerArguments
    format: str = flag(FORMAT_HELP, "|".join(FORMATS), choices=FORMATS)
    frame_times: Path | None = flag("column t_us: the time of each picture, by its number from 0", "CSV")
    replace: bool = flag("replace labels that are there already")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelExportArguments:
    """Write labels for another tool."""

    layer: LayerArguments
    format: str = flag(FORMAT_HELP, "|".join(FORMATS), choices=FORMATS)
    out: Path = flag("a folder; for hdf5 a file", "DIR")
    pictures: bool = flag("draw the events of each label as a PNG beside it")
    window_us: PositiveInt = flag("of a picture", "N", 2000)
    stride_us: PositiveInt | None = flag("time between the pictures of the clip", "N")
    unchecked: Literal["refuse", "drop"] = flag("tracknet: pictures without label", default="refuse")
    decimals: bool = flag("voc, tracknet: do not round to whole pixels")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelScoreArguments:
    """Score a detector against labels."""

    layer: LayerArguments
    detector: MethodArguments
    window_us: PositiveInt | None = flag("length of a window", "N", "the config's")
    picture: Path | None = flag("precision, recall and errors as a picture", "FILE.svg")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelAgreeArguments:
    """Compare two annotators, or one with the blind repeats."""

    layer: LayerArguments
    other: str | None = flag("the other annotator", "NAME", "blind repeats", name="with")


def run_import(arguments: LabelImportArguments) -> None:
    """Import as one step, and say what was rejected."""
    layer = arguments.layer
    with layer.open() as (recording, stream):
        if not arguments.source.exists():
            raise CommandError("no such file or folder", where=arguments.source)
        annotator = layer.annotator or "imported"
        times = _frame_times(arguments.frame_times) if arguments.frame_times else None
        context = ImportContext(stream.sensor, times, f"import {arguments.format}", stream.name)
        found = FORMATS[arguments.format].read(arguments.source, context)
        tool = f"rallyscope {version('rallyscope')}"
        with LabelStore.open(layer.folder, recording.uuid, stream.name, annotator, tool=tool) as store:
            new = [label for label in found.labels if arguments.replace or store.at(label.t_us) is None]
            store.edit(put=new)  # one step: one undo takes the whole import back
    there, rejections = len(found.labels) - len(new), [str(rejection) for rejection in found.rejections]
    lines = [f"{len(new)} labels imported for {annotator!r}, {there} were there already, {len(rejections)} rejected"]
    lines += rejections[:MAX_SHOWN]
    lines += [f"... and {len(rejections) - MAX_SHOWN} more, see --json"] if len(rejections) > MAX_SHOWN else []
    if not found.labels and rejections:
        raise LabelError(f"nothing could be imported, {len(rejections)} rejected", got=rejections[0])
    layer.tell({"annotator": annotator, "imported": len(new), "already_there": there, "rejected": rejections}, lines)


def run_export(arguments: LabelExportArguments) -> None:
    """Write the labels, and pictures of them, and say what the format could not hold."""
    out, layer = arguments.out, arguments.layer
    with layer.open() as (recording, stream):
        source = stream if isinstance(stream, LabelSource) else LabelSource(stream.name, stream.sensor, stream)
        store = _read_layer(layer, recording, stream)
        frames_us = tuple(range(0, recording.duration_us, arguments.stride_us)) if arguments.stride_us else None
        request = LabelFilesRequest(
            format=arguments.format,
            recording_uuid=recording.uuid,
            annotator=store.layer.annotator,
            source=source,
            labels=store.all(),
            frames_us=frames_us,
            pictures=arguments.pictures,
            window_us=arguments.window_us,
            options=ExportOptions(whole_pixels=not arguments.decimals, drop_unchecked=arguments.unchecked == "drop"),
        )
        with progress_bar("Drawing") if arguments.pictures else nullcontext(lambda share: None) as progress:
            made = write_label_files(request, out, progress)
    counts = {"labels": made.labels, "files": len(made.files), "pictures": len(made.pictures)}
    lines = [f"{counts['labels']} labels in {counts['files']} files, {counts['pictures']} pictures: {out}"]
    lines += [f"not in this format: {loss}" for loss in made.losses]
    layer.tell({**counts, "out": str(out), "losses": list(made.losses)}, lines)


def run_score(arguments: LabelScoreArguments) -> None:
    """Detect where there are labels, and compare."""
    method, folder = arguments.detector.method, arguments.layer.folder
    with arguments.layer.open() as (recording, stream):
        if isinstance(stream, LabelSource):
            raise CommandError("the detector works on events", got=f"the frames of {stream.name!r}", where="--camera")
        store = _read_layer(arguments.layer, recording, stream)
        config = arguments.detector.settings()
        window_us = arguments.window_us or config.window.window_us
        detector = make_detector(method, stream.sensor, config)
        labels = store.labels()
        asked = labels.rows(labels.state != STATES.index(LabelState.OCCLUDED))
        with progress_bar("Scoring") as progress:
            answers = answers_at(stream, detector, asked.t_us, window_us, progress=progress)
    scores, annotator, noise = score_groups(answers, asked), store.layer.annotator, _own_noise(folder, store)
    if arguments.picture is not None:
        title = f"{method}, {store.layer.camera}, against {len(labels)} labels by {annotator}"
        sigma_px = None if noise is None or not noise.both_seen else noise.sigma_px
        write_text(arguments.picture, score_svg(measure_curves(answers, asked), title, noise_px=sigma_px))
    report = {
        "annotator": annotator,
        "method": method,
        "window_us": window_us,
        "rows": [asdict(score) for score in scores],
        "annotator_noise": None if noise is None else asdict(noise),
    }
    arguments.layer.tell(report, [*_score_table(scores), _noise_line(noise)])


def run_agree(arguments: LabelAgreeArguments) -> None:
    """Compare the labels of the same instants."""
    with arguments.layer.open() as (recording, stream):
        first = _read_layer(arguments.layer, recording, stream)
    mine = first.layer.annotator
    name, blind = arguments.other or mine, arguments.other is None
    layer = Layer(first.layer.recording_uuid, first.layer.camera, name, blind)
    stores = first, LabelStore.read(arguments.layer.folder, layer)
    pair = [made_independently(store.labels()) for store in stores]
    left_out = sum(len(store.labels()) for store in stores) - sum(map(len, pair))
    found = measure_agreement(*pair)
    counts = (
        f"{mine!r} and {'blind repeats' if blind else repr(name)}: {found.common} common, "
        f"{found.only_first} and {found.only_second} of one only"
    )
    seen = [f"{left_out} labels left out: they settle conflicts"] if left_out else []
    told = {"first": mine, "second": name, "blind": blind, "left_out": left_out, **asdict(found)}
    arguments.layer.tell(told, [counts, *seen, *_agreement_lines(found)])


def _agreement_lines(found: Agreement) -> list[str]:
    """In words, and only what can be said: of nothing there is no median."""
    if not found.common:
        return ["no common labels: nothing can be compared"]
    kappa = "kappa not defined: both say one thing only" if isnan(found.kappa) else f"kappa {found.kappa:.3f}"
    states = f"states: {found.same_state} of {found.common} the same, {kappa}"
    if not found.both_seen:
        return [states, "positions: no common label in which both have seen the ball"]
    interval = "" if isnan(found.median_low_px) else f"({found.median_low_px:.2f} to {found.median_high_px:.2f}), "
    return [
        states,
        f"positions ({found.both_seen}): median {found.median_px:.2f} px {interval}p95 {found.p95_px:.2f}, "
        f"sigma of one {found.sigma_px:.2f} px, bias {found.bias_x_px:+.2f} {found.bias_y_px:+.2f}",
    ]


ACTS = {"import": run_import, "export": run_export, "score": run_score, "agree": run_agree, "merge": run_merge}


def read_layers(
    folder: Path, recording: Recording, cameras: Collection[str], annotator: str | None
) -> tuple[LabelStore, ...]:
    """What one annotator said of those cameras, a store for each that has labels.

    Raises:
        CommandError: if there is none, or several annotators and no name.
    """
    layers = [layer for layer in find_layers(folder, recording.uuid) if layer.camera in cameras and not layer.blind]
    names = sorted({layer.annotator for layer in layers})
    if not names:
        remedy = "label it in the app, or name the folder with --data"
        which = f"{'camera' if len(cameras) == 1 else 'cameras'} {', '.join(map(repr, cameras))}"
        raise CommandError(f"no labels of {which} of this recording", where=folder, remedy=remedy)
    if annotator is None and len(names) > 1:
        raise CommandError("whose labels?", expected=f"--annotator with one of {', '.join(names)}")
    name = annotator or names[0]
    if name not in names:
        raise CommandError(f"no labels by {name!r}", expected=f"one of {', '.join(names)}", where="--annotator")
    return tuple(LabelStore.read(folder, layer) for layer in layers if layer.annotator == name)


def _read_layer(arguments: LayerArguments, recording: Recording, stream: Labelled) -> LabelStore:
    """The layer that is meant; raises CommandError."""
    (store,) = read_layers(arguments.folder, recording, (stream.name,), arguments.annotator)
    return store


def _own_noise(folder: Path, store: LabelStore) -> Agreement | None:
    layer = Layer(store.layer.recording_uuid, store.layer.camera, store.layer.annotator, blind=True)
    if not has_labels(folder, layer):
        return None
    return measure_agreement(store.labels(), LabelStore.read(folder, layer).labels())


def _score_table(scores: tuple[GroupScore, ...]) -> list[str]:
    lines = ["labels         number  balls   P / R / F1 at 1, 2, 4, 8 px" + " " * 44 + "median   p95  along across px"]
    for score in scores:
        at = "   ".join(f"{row.precision:.3f}/{row.recall:.3f}/{row.f1:.3f}" for row in score.at)
        errors = f"{score.median_px:6.2f} {score.p95_px:6.2f} {score.along_px:+6.2f} {score.across_px:+6.2f}"
        lines.append(f"{score.group:<13} {score.labels:7d} {score.with_ball:6d}   {at}  {errors}")
    return lines


def _noise_line(noise: Agreement | None) -> str:
    if noise is None or not noise.both_seen:
        return "the annotator's own noise is not known: no blind repeats yet"
    return f"the annotator's own noise: median {noise.median_px:.2f} px, p95 {noise.p95_px:.2f} px between two looks"


def _frame_times(path: Path) -> NDArray[np.int64]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return np.array([int(row["t_us"]) for row in csv.DictReader(file)], np.int64)
    except OSError as error:
        raise CommandError("cannot read the frame times", got=error.strerror, where=path) from error
    except (KeyError, TypeError, ValueError) as error:
        raise CommandError("not frame times", expected="a column t_us of whole numbers", where=path) from error
