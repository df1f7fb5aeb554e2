"""`rallyscope import`: one event file, or the two of a stereo pair, becomes a recording."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from app.cli.arguments import positive_int
from app.cli.progress import progress_bar
from core.cameras import load_calibration
from core.errors import CommandError
from core.events import SensorSize
from core.recordings.frame_import import FrameInput
from core.recordings.importing import ImportSummary, import_recording

_FORMATS = (
    "Reads Prophesee RAW (EVT2, EVT2.1, EVT3) and DAT, AEDAT4, Event Stream, Metavision HDF5, DSEC, MVSEC and other "
    "HDF5 layouts, npz, npy and CSV; the format is recognised by content."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.description = f"Convert an event file, or a stereo pair, to a recording. {_FORMATS}"
    parser.usage = "rallyscope import SRC [SRC2] DST.h5 [options]"
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="SRC [SRC2] DST.h5", help="event file(s), and the result"
    )
    parser.add_argument("--names", type=_names, metavar="left,right", help="what to call the cameras")
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="calibration of the cameras, to be kept along")
    parser.add_argument(
        "--offset-us", type=int, default=0, metavar="N", help="add N to SRC2's times to get SRC's clock (default: 0)"
    )
    parser.add_argument("--width", type=positive_int, metavar="W", help="sensor width, overrides what the file says")
    parser.add_argument("--height", type=positive_int, metavar="H", help="sensor height, likewise")
    parser.add_argument("--frames", type=Path, metavar="VIDEO|FOLDER", help="pictures of an ordinary camera")
    parser.add_argument("--frame-times", type=Path, metavar="CSV", help="a time in us on SRC's clock for each picture")
    parser.add_argument("--exposure-us", type=positive_int, metavar="N", help="exposure of the pictures")
    parser.add_argument("--force", action="store_true", help="replace DST.h5 if it exists")
    parser.add_argument("--json", action="store_true", help="print what was made as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Import and say what was made."""
    if not 2 <= len(arguments.paths) <= 3:
        raise CommandError("wrong number of files", expected="SRC [SRC2] DST.h5", got=len(arguments.paths))
    *sources, destination = arguments.paths
    calibration = load_calibration(arguments.calibration) if arguments.calibration is not None else None
    with progress_bar(f"Importing {destination.name}") as progress:
        summary = import_recording(
            sources,
            destination,
            names=arguments.names,
            sensor=_sensor(arguments.width, arguments.height),
            calibration=calibration,
            offset_us=arguments.offset_us,
            frames=_frames(arguments.frames, arguments.frame_times, arguments.exposure_us),
            overwrite=arguments.force,
            progress=progress,
        )
    assert summary is not None  # nobody cancels but with Ctrl-C
    if arguments.json:
        print(json.dumps({**dataclasses.asdict(summary), "path": str(summary.path)}))
    else:
        print(_describe(summary))


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _sensor(width: int | None, height: int | None) -> SensorSize | None:
    if (width is None) != (height is None):
        raise CommandError("--width and --height go together", remedy="give both")
    return None if width is None or height is None else SensorSize(width, height)


def _frames(images: Path | None, times: Path | None, exposure_us: int | None) -> FrameInput | None:
    if images is None and times is None and exposure_us is None:
        return None
    if images is None or times is None or exposure_us is None:
        raise CommandError("--frames, --frame-times and --exposure-us go together", remedy="give all three")
    return FrameInput(images, times, exposure_us)


def _describe(summary: ImportSummary) -> str:
    lines = [f"{summary.path}: {summary.duration_us / 1e6:.3f} s"]
    for name, events in summary.events.items():
        triggers = summary.triggers[name]
        lines.append(f"  {name}: {events:,} events" + (f", {triggers:,} trigger edges" if triggers else ""))
    return "\n".join([*lines, *(f"  {note}" for note in summary.notes)])
