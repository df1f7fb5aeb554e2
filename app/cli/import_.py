"""`rallyscope import`: event files of any number of cameras become one recording."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Final

from app.cli.arguments import Counts, Names, PositiveInt, flag, positional, separated
from app.cli.progress import progress_bar
from app.cli.terminal import print_lines, say
from app.formatting import check_lines
from core.cameras.calibration_file import read_calibration_file
from core.cameras.distortion import COEFFICIENTS, LensModel
from core.errors import CommandError, EventsError, RecordingError
from core.events import SensorSize
from core.events.clock_table import read_clock_table
from core.foreign_tables import METRES, UNITS_US, Unit
from core.recordings.frame_import import FrameInput
from core.recordings.import_facts import ImportFacts
from core.recordings.import_feeds import ImportOrder
from core.recordings.importing import ImportSummary, check_import, import_recording
from core.recordings.opening import is_recording
from core.recordings.sources.readers import event_files
from core.recordings.sources.source import ImportOptions, parse_polarity
from core.text import counted


def _polarities(text: str) -> dict[str, bool]:
    try:
        return parse_polarity(text)
    except RecordingError as error:
        raise argparse.ArgumentTypeError(error.details) from error


def _time_unit(text: str) -> str:
    if text not in UNITS_US:
        raise ValueError
    return text


_RECORDINGS: Final = (".h5", ".hdf5")
Offsets = Annotated[tuple[int, ...], separated(int, "whole numbers")]
TimeUnits = Annotated[tuple[str, ...], separated(_time_unit, "units of time (ns, us, ms, s)")]
Polarities = Annotated[dict[str, bool], _polarities]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportArguments:
    """Convert event files, one or more for each camera of a rig, or a folder of them, to a recording. Reads
    Prophesee RAW (EVT2, EVT2.1, EVT3, EVT4) and DAT, AEDAT, Event Stream, Metavision HDF5, DSEC, MVSEC and other
    HDF5 layouts, npz, npy and CSV; the format is recognised by content.
    """

    USAGE: ClassVar = (
        "rallyscope import SRC [SRC2 ...] DST.h5 [options]\n       rallyscope import SRC [SRC2 ...] --check [options]"
    )
    paths: tuple[Path, ...] = positional(
        f"event files or a folder ({', '.join(dict.fromkeys(event_files().values()))}), and the result",
        "SRC [SRC2 ...] DST.h5",
    )
    names: Names | None = flag("what to call the cameras, in the order of the sources", "left,right")
    calibration: Path | None = flag("calibration of the cameras, to be kept along", "FILE")
    calibration_unit: Unit = flag("of the lengths in a calibration file", "|".join(METRES), "m", choices=METRES)
    calibration_model: LensModel | None = flag(
        "lens model of a calibration file that names none", "|".join(COEFFICIENTS), "what the file says"
    )
    offset_us: Offsets | None = flag(
        "add N to SRC2's times to get SRC's clock; of several sources a number for each: 0,120,...", "N[,N...]", "0"
    )
    clock: tuple[Path, ...] | None = flag(
        "how SRC2's clock drifted from SRC's, as `rallyscope record` wrote it; again for each further source",
        "FILE.csv",
        repeated=True,
    )
    width: Counts | None = flag("sensor width, overrides what the file says; or one for each source", "W[,W...]")
    height: Counts | None = flag("sensor height, likewise", "H[,H...]")
    time_unit: TimeUnits | None = flag(
        "unit of the times of a table that does not say it; or one for each source: ns,us", "ns|us|ms|s[,...]"
    )
    polarity: Polarities | None = flag("what the polarities of a table mean", "1=on,2=off")
    frames: Path | None = flag("pictures of an ordinary camera", "VIDEO|FOLDER")
    frame_times: Path | None = flag("a time in us on SRC's clock for each picture", "CSV")
    exposure_us: PositiveInt | None = flag("exposure of the pictures", "N")
    check: bool = flag("show what the files hold and what would be assumed or left out; write nothing")
    force: bool = flag("replace DST.h5 if it exists")
    json: bool = flag("print what was made, or with --check what was found, as JSON")


def run(arguments: ImportArguments) -> None:
    """Import and say what was made, or check and say what would be."""
    sources, destination = _files(arguments)
    order = _order(arguments, sources)
    if destination is None:
        with progress_bar(f"Checking {sources[0].name}") as progress:
            facts = check_import(order, progress=progress)
        assert facts is not None  # nobody cancels but with Ctrl-C
        _say_facts(facts, as_json=arguments.json)
        return
    with progress_bar(f"Importing {destination.name}") as progress:
        summary = import_recording(order, destination, overwrite=arguments.force, progress=progress)
    assert summary is not None
    if not arguments.json:
        say(_describe(summary))
        return
    made = {name: value for name, value in dataclasses.asdict(summary).items() if name != "facts"}
    say(json.dumps({**made, "path": str(summary.path), **_found(summary.facts)}))


def _order(arguments: ImportArguments, sources: Sequence[Path]) -> ImportOrder:
    """What is to be imported, and what the flags say of it."""
    calibration = None
    if arguments.calibration is None and (arguments.calibration_unit != "m" or arguments.calibration_model is not None):
        raise CommandError(
            "--calibration-unit and --calibration-model go with --calibration", remedy="give the file too"
        )
    if arguments.calibration is not None:
        calibration = read_calibration_file(
            arguments.calibration, unit=arguments.calibration_unit, model=arguments.calibration_model
        )
    units = arguments.time_unit or ()
    return ImportOrder(
        sources,
        names=arguments.names,
        sensor=_sensor(arguments.width, arguments.height),
        calibration={} if calibration is None else calibration.cameras,
        offset_us=_one_or_all(arguments.offset_us),
        clock=[read_clock_table(path) for path in arguments.clock or ()],
        options=ImportOptions(units[0] if len(units) == 1 else None, arguments.polarity),
        time_units=units if len(units) > 1 else (),
        frames=_frames(arguments.frames, arguments.frame_times, arguments.exposure_us),
        remarks=() if calibration is None else calibration.notes,
    )


def _files(arguments: ImportArguments) -> tuple[list[Path], Path | None]:
    """The sources, and the recording to be made; None if nothing is to be written."""
    paths = list(arguments.paths)
    if not arguments.check:
        if len(paths) < 2:
            raise CommandError("wrong number of files", expected="SRC [SRC2 ...] DST.h5", got=len(paths))
        return paths[:-1], paths[-1]
    if len(paths) > 1 and _is_result(paths[-1]):  # the command of an import with --check behind it
        paths.pop()
    return paths, None


def _is_result(path: Path) -> bool:
    """Whether a file can only be the recording that an import would make."""
    return is_recording(path) or (path.suffix.lower() in _RECORDINGS and not path.exists())


def _say_facts(facts: ImportFacts, *, as_json: bool) -> None:
    if as_json:
        say(json.dumps({"duration_us": facts.duration_us, "notes": list(facts.notes), **_found(facts)}))
    else:
        print_lines([*check_lines(facts), "Nothing was written."])


def _found(facts: ImportFacts) -> dict[str, object]:
    """What importing and checking both say in JSON: each camera, and what is assumed."""
    cameras = [dataclasses.asdict(camera) for camera in facts.cameras]
    return {"cameras": cameras, "assumed": list(facts.assumed)}


def _one_or_all(offsets_us: tuple[int, ...] | None) -> int | tuple[int, ...]:
    """A single number is of all sources after the first."""
    if offsets_us is None:
        return 0
    return offsets_us[0] if len(offsets_us) == 1 else offsets_us


def _sensor(
    widths: tuple[int, ...] | None, heights: tuple[int, ...] | None
) -> SensorSize | tuple[SensorSize, ...] | None:
    if (widths is None) != (heights is None):
        raise CommandError("--width and --height go together", remedy="give both")
    if widths is None or heights is None:
        return None
    if len(widths) != len(heights):
        raise CommandError("as many widths as heights", expected=len(widths), got=len(heights), where="--height")
    try:
        sizes = tuple(SensorSize(*size) for size in zip(widths, heights, strict=True))
    except EventsError as error:
        raise CommandError(str(error), where="--width and --height") from error
    return sizes[0] if len(sizes) == 1 else sizes


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
        lines.append(
            f"  {name}: {counted(events, 'event')}" + (f", {counted(triggers, 'trigger edge')}" if triggers else "")
        )
    return "\n".join([*lines, *(f"  {note}" for note in summary.notes)])
