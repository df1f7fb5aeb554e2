"""`rallyscope labels import|export|score|agree`: exchange labels with other tools, and measure with them."""

from __future__ import annotations

import argparse
import csv
import json
import math
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from app.cli.arguments import positive_int
from app.cli.detect import choose_camera
from app.cli.progress import progress_bar
from app.modes.label.sources import LabelSource, sources_of
from core.config import load_config
from core.detection import DetectorConfig, make_detector
from core.detection.methods import METHODS, method_config
from core.errors import CommandError, LabelError
from core.recordings import CameraStream, Recording, open_recording
from labels.agreement import Agreement, measure_agreement
from labels.arrays import STATES
from labels.formats import FORMATS, ExportOptions, ImportContext, LabelSet
from labels.formats.exchange import picture_name, write_bytes, write_text
from labels.formats.pictures import write_pictures
from labels.model import Label, LabelState
from labels.score import GroupScore, answers_at, score_groups
from labels.score_picture import measure_curves, score_svg
from labels.store import LabelStore, Layer, find_layers

Labelled = CameraStream | LabelSource
"""An event camera, or the frames of an ordinary one."""
MAX_SHOWN = 20
"""Rejections printed one by one; `--json` has them all."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    acts = parser.add_subparsers(dest="act", required=True, metavar="import|export|score|agree")
    formats = "; ".join(f"{name}: {item.summary}" for name, item in FORMATS.items())

    add = acts.add_parser("import", help="take labels from files of another tool")
    add.add_argument("source", type=Path, metavar="SRC", help="a file, or a folder of files")
    _add_common(add)
    add.add_argument("--format", required=True, choices=FORMATS, metavar="|".join(FORMATS), help=formats)
    add.add_argument(
        "--frame-times", type=Path, metavar="CSV", help="column t_us: the time of each picture, by its number from 0"
    )
    add.add_argument("--replace", action="store_true", help="replace labels that are there already")

    out = acts.add_parser("export", help="write labels for another tool")
    _add_common(out)
    out.add_argument("--format", required=True, choices=FORMATS, metavar="|".join(FORMATS), help=formats)
    out.add_argument("--out", type=Path, required=True, metavar="DIR", help="a folder; for hdf5 a file")
    out.add_argument("--pictures", action="store_true", help="draw the events of each label as a PNG beside it")
    out.add_argument("--window-us", type=positive_int, default=2000, metavar="N", help="of a picture (%(default)s)")
    out.add_argument("--stride-us", type=positive_int, metavar="N", help="time between the pictures of the clip")
    out.add_argument(
        "--unchecked", choices=("refuse", "drop"), default="refuse", help="tracknet: pictures without label"
    )
    out.add_argument("--decimals", action="store_true", help="voc, tracknet: do not round to whole pixels")

    score = acts.add_parser("score", help="score a detector against labels")
    _add_common(score)
    score.add_argument("--method", default="auto", choices=METHODS, metavar="|".join(METHODS), help="(%(default)s)")
    score.add_argument("--config", type=Path, metavar="FILE", help="settings saved in the app, a TOML file")
    score.add_argument("--window-us", type=positive_int, metavar="N", help="length of a window (the config's)")
    score.add_argument("--picture", type=Path, metavar="FILE.svg", help="precision, recall and errors as a picture")

    agree = acts.add_parser("agree", help="compare two annotators, or one with the blind repeats")
    _add_common(agree)
    agree.add_argument("--with", dest="other", metavar="NAME", help="the other annotator (default: blind repeats)")


def run(arguments: argparse.Namespace) -> None:
    """Do what the sub-verb says."""
    recording = open_recording(arguments.recording)
    try:
        frames = sources_of(recording).get(arguments.camera or "")
        stream = frames if frames is not None and frames.frames is not None else None
        stream = stream or choose_camera(recording, arguments.camera)
        act = {"import": _import, "export": _export, "score": _score, "agree": _agree}[arguments.act]
        report, text = act(arguments, recording, stream)
    finally:
        recording.close()
    print(json.dumps(_plain(report)) if arguments.json else text)


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("recording", type=Path, metavar="REC", help="the recording that was labelled")
    parser.add_argument("--camera", metavar="NAME", help="which camera; needed if there are several")
    parser.add_argument("--annotator", metavar="NAME", help="whose labels; needed if there are several")
    parser.add_argument("--data", type=Path, default=Path("rallyscope-data"), metavar="DIR", help="(%(default)s)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def _import(arguments: argparse.Namespace, recording: Recording, stream: Labelled) -> tuple[dict, str]:
    if not arguments.source.exists():
        raise CommandError("no such file or folder", where=arguments.source)
    annotator = arguments.annotator or "imported"
    times = _frame_times(arguments.frame_times) if arguments.frame_times else None
    context = ImportContext(stream.sensor, times, f"import {arguments.format}", stream.name)
    found = FORMATS[arguments.format].read(arguments.source, context)
    folder, tool = arguments.data / "labels", f"rallyscope {version('rallyscope')}"
    with LabelStore.open(folder, recording.uuid, stream.name, annotator, tool=tool) as store:
        kept = [label for label in found.labels if not arguments.replace and store.at(label.t_us) is not None]
        new = [label for label in found.labels if arguments.replace or store.at(label.t_us) is None]
        store.edit(put=new)  # one step: one undo takes the whole import back
    rejections = [str(rejection) for rejection in found.rejections]
    report = {"annotator": annotator, "imported": len(new), "already_there": len(kept), "rejected": rejections}
    lines = [
        f"{len(new)} labels imported for {annotator!r}, {len(kept)} were there already, {len(rejections)} rejected"
    ]
    lines += rejections[:MAX_SHOWN]
    lines += [f"... and {len(rejections) - MAX_SHOWN} more, see --json"] if len(rejections) > MAX_SHOWN else []
    if not found.labels and rejections:
        raise LabelError(f"nothing could be imported, {len(rejections)} rejected", got=rejections[0])
    return report, "\n".join(lines)


def _export(arguments: argparse.Namespace, recording: Recording, stream: Labelled) -> tuple[dict, str]:
    store = _read_layer(arguments, recording, stream)
    frames = None
    if arguments.stride_us:
        frames = tuple(range(0, recording.duration_us, arguments.stride_us))
    if isinstance(stream, LabelSource) and stream.frames_us is not None:
        frames = tuple(stream.frames_us.tolist())
    labels = LabelSet(recording.uuid, stream.name, store.layer.annotator, stream.sensor, store.all(), frames)
    options = ExportOptions(whole_pixels=not arguments.decimals, drop_unchecked=arguments.unchecked == "drop")
    kind = FORMATS[arguments.format]
    written = kind.write(labels, arguments.out, options)
    pictures = ()
    if arguments.pictures:
        if not kind.pictures:
            raise CommandError(f"{kind.name} has no pictures", where="--pictures")
        with progress_bar("Drawing") as progress:
            if isinstance(stream, LabelSource):
                pictures = write_label_pictures(stream, labels.labels, arguments.out, progress)
            else:
                pictures = write_pictures(
                    stream, labels.labels, arguments.out, window_us=arguments.window_us, progress=progress
                )
    report = {"labels": len(labels.labels), "files": len(written.files), "pictures": len(pictures)}
    lines = [f"{report['labels']} labels in {report['files']} files, {report['pictures']} pictures: {arguments.out}"]
    lines += [f"not in this format: {loss}" for loss in written.losses]
    return {**report, "out": str(arguments.out), "losses": list(written.losses)}, "\n".join(lines)


def write_label_pictures(
    source: LabelSource, labels: tuple[Label, ...], folder: Path, progress: Callable[[float], None]
) -> tuple[Path, ...]:
    """The frame under each label as a PNG."""
    files = []
    for number, label in enumerate(labels):
        frame = source.frame_at(label.t_us)
        assert frame is not None
        image = source.frame(frame)
        fine, content = cv2.imencode(".png", image if image.ndim == 2 else image[:, :, ::-1])
        assert fine
        files.append(write_bytes(folder / f"{picture_name(source.name, label.t_us)}.png", content.tobytes()))
        progress((number + 1) / len(labels))
    return tuple(files)


def _score(arguments: argparse.Namespace, recording: Recording, stream: Labelled) -> tuple[dict, str]:
    if isinstance(stream, LabelSource):
        raise CommandError("the detector works on events", got=f"the frames of {stream.name!r}", where="--camera")
    store = _read_layer(arguments, recording, stream)
    saved = load_config(DetectorConfig, arguments.config) if arguments.config else None
    config = method_config(arguments.method, saved)
    window_us = arguments.window_us or config.window.window_us
    detector = make_detector(arguments.method, stream.sensor, config)
    labels = store.labels()
    asked = labels.rows(labels.state != STATES.index(LabelState.OCCLUDED))
    with progress_bar("Scoring") as progress:
        answers = answers_at(stream, detector, asked.t_us, window_us, progress=progress)
    scores = score_groups(answers, asked)
    noise = _own_noise(arguments.data / "labels", store)
    if arguments.picture is not None:
        title = f"{arguments.method}, {stream.name}, against {len(labels)} labels by {store.layer.annotator}"
        sigma_px = None if noise is None or not noise.both_seen else noise.sigma_px
        write_text(arguments.picture, score_svg(measure_curves(answers, asked), title, noise_px=sigma_px))
    report = {
        "annotator": store.layer.annotator,
        "method": arguments.method,
        "window_us": window_us,
        "rows": [asdict(score) for score in scores],
        "annotator_noise": None if noise is None else asdict(noise),
    }
    return report, "\n".join([_score_table(scores), _noise_line(noise)])


def _agree(arguments: argparse.Namespace, recording: Recording, stream: Labelled) -> tuple[dict, str]:
    first = _read_layer(arguments, recording, stream)
    name, blind = arguments.other or first.layer.annotator, arguments.other is None
    folder = arguments.data / "labels"
    second = LabelStore.read(folder, Layer(recording.uuid, stream.name, name, blind))
    found = measure_agreement(first.labels(), second.labels())
    what = "blind repeats" if blind else repr(name)
    lines = [
        f"{first.layer.annotator!r} and {what}: {found.common} common, "
        f"{found.only_first} and {found.only_second} of one only",
        f"states: {found.same_state} the same, kappa {found.kappa:.3f}",
        f"positions ({found.both_seen}): median {found.median_px:.2f} px "
        f"({found.median_low_px:.2f} to {found.median_high_px:.2f}), p95 {found.p95_px:.2f}, "
        f"sigma of one {found.sigma_px:.2f} px, bias {found.bias_x_px:+.2f} {found.bias_y_px:+.2f}",
    ]
    return {"first": first.layer.annotator, "second": name, "blind": blind, **asdict(found)}, "\n".join(lines)


def _read_layer(arguments: argparse.Namespace, recording: Recording, stream: Labelled) -> LabelStore:
    """The layer that is meant.

    Raises:
        CommandError: if there is none, or several and no name.
    """
    folder = arguments.data / "labels"
    layers = [layer for layer in find_layers(folder, recording.uuid) if layer.camera == stream.name and not layer.blind]
    names = [layer.annotator for layer in layers]
    if not names:
        remedy = "label it in the app, or name the folder with --data"
        raise CommandError(f"no labels of camera {stream.name!r} of this recording", where=folder, remedy=remedy)
    if arguments.annotator is None and len(names) > 1:
        raise CommandError("whose labels?", expected=f"--annotator with one of {', '.join(names)}")
    name = arguments.annotator or names[0]
    if name not in names:
        raise CommandError(f"no labels by {name!r}", expected=f"one of {', '.join(names)}", where="--annotator")
    return LabelStore.read(folder, layers[names.index(name)])


def _own_noise(folder: Path, store: LabelStore) -> Agreement | None:
    layer = Layer(store.layer.recording_uuid, store.layer.camera, store.layer.annotator, blind=True)
    if not layer.path(folder).is_file():
        return None
    return measure_agreement(store.labels(), LabelStore.read(folder, layer).labels())


def _score_table(scores: tuple[GroupScore, ...]) -> str:
    lines = ["labels         number  balls   P / R / F1 at 1, 2, 4, 8 px" + " " * 44 + "median   p95  along across px"]
    for score in scores:
        at = "   ".join(f"{row.precision:.3f}/{row.recall:.3f}/{row.f1:.3f}" for row in score.at)
        errors = f"{score.median_px:6.2f} {score.p95_px:6.2f} {score.along_px:+6.2f} {score.across_px:+6.2f}"
        lines.append(f"{score.group:<13} {score.labels:7d} {score.with_ball:6d}   {at}  {errors}")
    return "\n".join(lines)


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


def _plain(value: object) -> object:
    """For JSON, which knows no nan."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
