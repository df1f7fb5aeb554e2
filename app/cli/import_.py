"""`rallyscope import`: one event file, or the two of a stereo pair, becomes a recording."""

from __future__ import annotations

import argparse
import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from app.cli.arguments import Names, PositiveInt, flag, positional
from app.cli.progress import progress_bar
from app.cli.terminal import say
from core.cameras.calibration_file import read_calibration_file
from core.cameras.distortion import COEFFICIENTS, LensModel
from core.cameras.units import METRES, Unit
from core.errors import CommandError
from core.events import SensorSize
from core.events.clock_table import read_clock_table
from core.recordings.frame_import import FrameInput
from core.recordings.importing import ImportSummary, import_recording
from core.recordings.sources.readers import event_files
from core.recordings.sources.source import Stated


def _polarities(text: str) -> dict[str, bool]:
    """Value -> whether it is ON, from words such as 1=on,2=off."""
    found: dict[str, bool] = {}
    for word in text.split(","):
        value, equals, meaning = word.rpartition("=")
        if not equals or not value.strip() or meaning.strip().lower() not in ("on", "off"):
            raise argparse.ArgumentTypeError(f"expected such as 1=on,2=off, got {text!r}")
        found[value.strip()] = meaning.strip().lower() == "on"
    return found


Polarities = Annotated[dict[str, bool], _polarities]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportArguments:
    """Convert an event file, or a stereo pair, to a recording. Reads Prophesee RAW (EVT2, EVT2.1, EVT3) and DAT,
    AEDAT4, Event Stream, Metavision HDF5, DSEC, MVSEC and other HDF5 layouts, npz, npy and CSV; the format is
    recognised by content.
    """

    USAGE: ClassVar = "rallyscope import SRC [SRC2] DST.h5 [options]"
    paths: tuple[Path, ...] = positional(
        f"event file(s) ({', '.join(dict.fromkeys(event_files().values()))}), and the result", "SRC [SRC2] DST.h5"
    )
    names: Names | None = flag("what to call the cameras", "left,right")
    calibration: Path | None = flag("calibration of the cameras, to be kept along", "FILE")
    calibration_unit: Unit = flag("of the lengths in a calibration file", "|".join(METRES), "m", choices=METRES)
    calibration_model: LensModel | None = flag(
        "lens model of a calibration file that names none", "|".join(COEFFICIENTS), "what the file says"
    )
    offset_us: int = flag("add N to SRC2's times to get SRC's clock", "N", 0)
    clock: Path | None = flag("how SRC2's clock drifted from SRC's, as `rallyscope record` wrote it", "FILE.csv")
    width: PositiveInt | None = flag("sensor width, overrides what the file says", "W")
    height: PositiveInt | None = flag("sensor height, likewise", "H")
    time_unit: Literal["ns", "us", "ms", "s"] | None = flag("unit of the times of a table that does not say it")
    polarity: Polarities | None = flag("what the polarities of a table mean", "1=on,2=off")
    frames: Path | None = flag("pictures of an ordinary camera", "VIDEO|FOLDER")
    frame_times: Path | None = flag("a time in us on SRC's clock for each picture", "CSV")
    exposure_us: PositiveInt | None = flag("exposure of the pictures", "N")
    force: bool = flag("replace DST.h5 if it exists")
    json: bool = flag("print what was made as JSON")


def run(arguments: ImportArguments) -> None:
    """Import and say what was made."""
    if not 2 <= len(arguments.paths) <= 3:
        raise CommandError("wrong number of files", expected="SRC [SRC2] DST.h5", got=len(arguments.paths))
    *sources, destination = arguments.paths
    calibration = None
    if arguments.calibration is None and (arguments.calibration_unit != "m" or arguments.calibration_model is not None):
        raise CommandError(
            "--calibration-unit and --calibration-model go with --calibration", remedy="give the file too"
        )
    if arguments.calibration is not None:
        calibration = read_calibration_file(
            arguments.calibration, unit=arguments.calibration_unit, model=arguments.calibration_model
        )
    with progress_bar(f"Importing {destination.name}") as progress:
        summary = import_recording(
            sources,
            destination,
            names=arguments.names,
            sensor=_sensor(arguments.width, arguments.height),
            calibration=None if calibration is None else calibration.cameras,
            remarks=() if calibration is None else calibration.notes,
            offset_us=arguments.offset_us,
            clock=read_clock_table(arguments.clock) if arguments.clock is not None else None,
            stated=Stated(arguments.time_unit, arguments.polarity),
            frames=_frames(arguments.frames, arguments.frame_times, arguments.exposure_us),
            overwrite=arguments.force,
            progress=progress,
        )
    assert summary is not None  # nobody cancels but with Ctrl-C
    report = {**dataclasses.asdict(summary), "path": str(summary.path)}
    say(json.dumps(report) if arguments.json else _describe(summary))


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
