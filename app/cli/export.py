"""`rallyscope export`: what people take away from a recording or a training run, in the formats of other tools."""

from __future__ import annotations

import json
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from app.cli.arguments import DATA, PositiveInt, flag, one_of, positional
from app.cli.detector_arguments import MethodArguments
from app.cli.progress import Progress, progress_bar
from app.cli.terminal import say, silence_viser
from app.export.formats import FORMATS, ExportRequest, export, is_run, time_note
from app.export.selection import span_of
from core.chain import ChainConfig
from core.errors import CommandError
from core.recordings import open_recording
from labels.arrays import LabelArrays
from labels.store import LabelStore, find_layers


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportArguments:
    """Write a recording, or a training run, for other tools."""

    source: Path = positional("a recording, or the folder of a training run", "REC|RUN")
    to: tuple[str, Path] = one_of(FORMATS.view(lambda kind: (kind.what, "DIR" if kind.folder else "F")))
    start_us: int | None = flag("start time in the recording, us", "N", "its start")
    end_us: PositiveInt | None = flag("end time in the recording, us", "N", "its end")
    stride_us: PositiveInt | None = flag("time between two pictures", "N", "4000; mp4: 10000")
    detector: MethodArguments
    annotator: str | None = flag("rrd: whose labels to show along", "NAME")
    seed: int | None = flag("onnx, and mp4 of a run: which seed", "N", "the run's first")
    best: bool = flag("onnx: the best policy instead of the last")
    data: Path = flag("workspace", "DIR", DATA)
    force: bool = flag("overwrite existing files")
    json: bool = flag("print what was made as JSON")


def run(arguments: ExportArguments) -> None:
    """Export and say what was made."""
    name, destination = arguments.to
    silence_viser()
    started_s = time.perf_counter()
    with progress_bar(f"Exporting {destination.name}") as progress:
        files, note = _export(arguments, progress)
    seconds = time.perf_counter() - started_s
    if arguments.json:
        made = [{"path": str(path), "bytes": path.stat().st_size} for path in files]
        times = {"times": note} if note else {}
        say(json.dumps({"format": name, "files": made, "seconds": round(seconds, 3), **times}))
        return
    for path in files:
        say(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
    if note:
        say(note)


def _export(arguments: ExportArguments, progress: Progress) -> tuple[tuple[Path, ...], str]:
    """The files, and how their times relate to the recording's, if they differ."""
    name, destination = arguments.to
    order = ExportRequest(
        format=name,
        destination=destination,
        start_us=arguments.start_us,
        end_us=arguments.end_us,
        stride_us=arguments.stride_us,
        chain=ChainConfig.of_method(*arguments.detector.settings()),
        overwrite=arguments.force,
        seed=arguments.seed,
        policy="best" if arguments.best else "last",
    )
    if is_run(arguments.source):
        return export(order, run=arguments.source, progress=progress), ""
    with closing(open_recording(arguments.source)) as recording:
        labels = _labels(arguments.data / "labels", recording.uuid, arguments.annotator)
        made = export(order, recording=recording, groups=recording.read_rows, labels=labels, progress=progress)
        return made, time_note(name, recording, span_of(recording, arguments.start_us, arguments.end_us))


def _labels(folder: Path, uuid: str, annotator: str | None) -> dict[str, LabelArrays]:
    if annotator is None:
        return {}
    layers = find_layers(folder, uuid)
    mine = [layer for layer in layers if layer.annotator == annotator and not layer.blind]
    if not mine:
        known = ", ".join(sorted({layer.annotator for layer in layers})) or "nobody"
        raise CommandError("no labels of this annotator", expected=known, got=annotator, where="--annotator")
    return {layer.camera: LabelStore.read(folder, layer).labels() for layer in mine}
