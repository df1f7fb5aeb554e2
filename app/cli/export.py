"""`rallyscope export`: what people take away from a recording or a training run, in the formats of other tools."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from app.cli.arguments import positive_int
from app.cli.progress import Progress, progress_bar
from app.cli.quiet_viser import silence_viser
from app.export.formats import FORMATS, ExportRequest, export, is_run
from core.config import load_config
from core.detection import DetectorConfig
from core.detection.methods import METHODS, method_config
from core.errors import CommandError
from core.rally import ChainConfig
from core.recordings import open_recording
from labels.arrays import LabelArrays
from labels.store import LabelStore, find_layers


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("source", type=Path, metavar="REC|RUN", help="a recording, or the folder of a training run")
    to = parser.add_mutually_exclusive_group(required=True)
    for name, kind in FORMATS.items():
        to.add_argument(f"--{name}", type=Path, metavar="DIR" if kind.folder else "F", help=kind.what)
    parser.add_argument("--start-us", type=int, metavar="N", help="from this time of the recording on (its start)")
    parser.add_argument("--end-us", type=positive_int, metavar="N", help="up to this time (its end)")
    parser.add_argument(
        "--stride-us", type=positive_int, metavar="N", help="time between two pictures (default: 4000; mp4: 10000)"
    )
    parser.add_argument("--method", default="auto", choices=METHODS, metavar="|".join(METHODS), help="(%(default)s)")
    parser.add_argument("--config", type=Path, metavar="FILE", help="detector settings saved in the app, a TOML file")
    parser.add_argument("--annotator", metavar="NAME", help="rrd: whose labels to show along")
    parser.add_argument("--seed", type=int, metavar="N", help="onnx: whose actor (default: the run's first)")
    parser.add_argument("--best", action="store_true", help="onnx: the best policy instead of the last")
    parser.add_argument("--data", type=Path, default=Path("rallyscope-data"), metavar="DIR", help="(%(default)s)")
    parser.add_argument("--force", action="store_true", help="replace what exists")
    parser.add_argument("--json", action="store_true", help="print what was made as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Export and say what was made."""
    name = next(name for name in FORMATS if getattr(arguments, name) is not None)
    destination: Path = getattr(arguments, name)
    silence_viser()
    started_s = time.perf_counter()
    with progress_bar(f"Exporting {destination.name}") as progress:
        files = _export(arguments, name, destination, progress)
    seconds = time.perf_counter() - started_s
    if arguments.json:
        made = [{"path": str(path), "bytes": path.stat().st_size} for path in files]
        print(json.dumps({"format": name, "files": made, "seconds": round(seconds, 3)}))
        return
    for path in files:
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")


def _export(arguments: argparse.Namespace, name: str, destination: Path, progress: Progress) -> tuple[Path, ...]:
    saved = load_config(DetectorConfig, arguments.config) if arguments.config else None
    chain = ChainConfig(method=arguments.method, detector=method_config(arguments.method, saved))
    order = ExportRequest(
        format=name,
        destination=destination,
        start_us=arguments.start_us,
        end_us=arguments.end_us,
        stride_us=arguments.stride_us,
        chain=chain,
        overwrite=arguments.force,
        seed=arguments.seed,
        policy="best" if arguments.best else "last",
    )
    if is_run(arguments.source):
        return export(order, run=arguments.source, progress=progress)
    recording = open_recording(arguments.source)
    try:
        labels = _labels(arguments.data / "labels", recording.uuid, arguments.annotator)
        return export(order, recording=recording, groups=recording.read_rows, labels=labels, progress=progress)
    finally:
        recording.close()


def _labels(folder: Path, uuid: str, annotator: str | None) -> dict[str, LabelArrays]:
    if annotator is None:
        return {}
    layers = find_layers(folder, uuid)
    mine = [layer for layer in layers if layer.annotator == annotator and not layer.blind]
    if not mine:
        known = ", ".join(sorted({layer.annotator for layer in layers})) or "nobody"
        raise CommandError("no labels of this annotator", expected=known, got=annotator, where="--annotator")
    return {layer.camera: LabelStore.read(folder, layer).labels() for layer in mine}
