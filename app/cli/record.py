"""`rallyscope record`: what event cameras or another live source see, as a recording."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from app.cli.arguments import PositiveFloat, flag
from app.cli.ending import EndRequest, end_event
from app.cli.event_cameras import (
    CAMERA,
    CameraArguments,
    CameraOrder,
    open_camera_source,
    open_cameras,
    read_camera_order,
)
from app.cli.progress import progress_bar
from app.cli.replay import REPLAY, open_replay, read_replay
from app.cli.terminal import format_table, say
from core.errors import CommandError, RallyscopeError
from core.text import counted

if TYPE_CHECKING:
    from core.devices.raw_recorder import RawRecorder, RawTake
    from core.live.link.live_source import LiveSource

LOOK_S: Final = 0.2
SAY_S: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordArguments:
    """Record event cameras or a simulation until Ctrl-C, or a replay to its end. The raw data of
    Prophesee cameras is written while they run, and is converted at the end.
    """

    source: str | None = flag("what to record", "camera:SERIAL[,SERIAL...]|replay:FILE[@SPEED]|tcp://HOST:PORT")
    out: Path | None = flag("recording to write", "REC.h5")
    seconds: PositiveFloat | None = flag("stop after S seconds", "S", "at Ctrl-C")
    list: bool = flag("list the connected cameras and exit")
    cameras: CameraArguments
    loop: bool = flag("repeat a replayed file until Ctrl-C or --seconds, instead of recording it once")
    keep_raw: bool = flag("also keep the cameras' RAW files")
    force: bool = flag("overwrite existing files")
    json: bool = flag("print what was made as JSON")


def run(arguments: RecordArguments) -> None:
    """Record and say what was made."""
    if arguments.list:
        _say_cameras(as_json=arguments.json)
        return
    source, out = arguments.source, arguments.out
    if source is None or out is None:
        raise CommandError("nothing to record", expected="--source and --out, or --list")
    if arguments.loop and not source.startswith(REPLAY):
        raise CommandError("--loop is for a replay", expected="--source replay:FILE[@SPEED]", got=repr(source))
    if not source.startswith((CAMERA, REPLAY, "tcp://")):
        expected = "camera:SERIAL[,SERIAL...], replay:FILE[@SPEED] or tcp://HOST:PORT"
        raise CommandError("not a source", expected=expected, got=repr(source), where="--source")
    if out.exists() and not arguments.force:
        raise CommandError("the file exists", where=out, remedy="choose another name, or --force")
    order = read_camera_order(source, arguments.cameras)
    if order is not None and _all_evt3(order):
        report = _record_raw(order, out, arguments)
    else:
        report = _record_blocks(_open_source(source, order, loop=arguments.loop), out, arguments)
    say(json.dumps(report) if arguments.json else _describe(report))


def _say_cameras(*, as_json: bool) -> None:
    from core.devices.models import MODELS
    from core.devices.neuromorphic import list_cameras

    rows: list[dict[str, object]] = [
        {
            "serial": one.serial or "-",
            "model": one.name,
            "connection": one.connection,
            "offers": MODELS[one.name].offers if one.name in MODELS else "not known here",
            "problem": one.problem or "",
        }
        for one in list_cameras()
    ]
    if as_json:
        say(json.dumps({"cameras": rows}))
    else:
        say(format_table(rows) if rows else "no event camera is connected")


def _all_evt3(order: CameraOrder) -> bool:
    from core.devices.models import MODELS
    from core.devices.neuromorphic import list_cameras

    models = [MODELS.get(one.name) for one in list_cameras() if one.serial in order.serials.values()]
    return all(model is None or model.evt3 for model in models)


def _open_source(source: str, order: CameraOrder | None, *, loop: bool) -> LiveSource:
    if order is not None:
        return open_camera_source(order)
    replay = read_replay(source)
    if replay is not None:
        return open_replay(replay, loop=loop)
    from core.live.link.client import SimulationClient

    return SimulationClient(source)


def _wait(ended: EndRequest, seconds: float | None, over: Callable[[], bool], tell: Callable[[], str]) -> None:
    """Until it is enough, or there is nothing more."""
    began_s = reported_s = time.monotonic()
    while not over() and (seconds is None or time.monotonic() - began_s < seconds):
        left_s = LOOK_S if seconds is None else min(LOOK_S, max(0.0, began_s + seconds - time.monotonic()))
        if ended.wait(left_s):
            return
        if time.monotonic() - reported_s > SAY_S:
            reported_s = time.monotonic()
            say(f"{reported_s - began_s:.0f} s, {tell()}", error=True)


def _record_blocks(source: LiveSource, out: Path, arguments: RecordArguments) -> dict[str, object]:
    """By the blocks that a live source tells."""
    from core.history.record_live import LiveRecorder
    from core.recordings import open_recording

    ended = end_event()
    try:
        replayed = arguments.source is not None and arguments.source.startswith(REPLAY)
        recorder = LiveRecorder(source, out, from_start=replayed, overwrite=arguments.force)
        say(f"Recording {source.description} (Ctrl-C ends it)", error=True)
        _wait(ended, arguments.seconds, lambda: not recorder.recording or source.status == "lost", lambda: "recording")
        duration_us = recorder.stop()
    finally:
        source.close()
    with open_recording(out) as recording:
        events = {name: stream.event_count for name, stream in recording.cameras.items()}
        frames, notes = {name: len(stream) for name, stream in recording.frames.items()}, list(recording.notes)
    return {"path": str(out), "duration_us": duration_us, "events": events, "frames": frames, "notes": notes}


def _record_raw(order: CameraOrder, out: Path, arguments: RecordArguments) -> dict[str, object]:
    """The bytes of the cameras as they come; then the recording is made of them."""
    from core.devices.raw_recorder import RawRecorder

    recorder = RawRecorder(open_cameras(order, raw=True), out, cable=order.cable, overwrite=arguments.force)
    ended = end_event()
    say(f"Recording {' and '.join(order.serials.values())} (Ctrl-C ends it)", error=True)
    try:
        _wait(ended, arguments.seconds, lambda: recorder.over, lambda: f"{recorder.bytes_written / 1e6:.0f} MB")
    finally:
        takes = recorder.stop()
    return _make_recording(recorder, takes, order, out, arguments)


def _make_recording(
    recorder: RawRecorder, takes: tuple[RawTake, ...], order: CameraOrder, out: Path, arguments: RecordArguments
) -> dict[str, object]:
    from core.events.clock_table import read_clock_table
    from core.recordings import ImportOrder, import_recording

    paths = [one.path for one in takes]
    tables = list(recorder.clock_paths.values())
    notes = [note for one in takes for note in _losses(one)]
    again = " ".join(["rallyscope import", *map(str, [*paths, out]), *(f"--clock {table}" for table in tables)])
    if recorder.error is not None:
        say(f"what the cameras sent is kept; when there is room for the recording: {again}", error=True)
        raise recorder.error
    try:
        made_of = ImportOrder(
            paths, names=[one.name for one in takes], calibration=order.calibration,
            clock=[read_clock_table(table) for table in tables], remarks=notes,
        )  # fmt: skip
        with progress_bar(f"Making {out.name}") as progress:
            summary = import_recording(made_of, out, overwrite=arguments.force, progress=progress)
    except RallyscopeError:
        say(f"what the cameras sent is kept; to try again: {again}", error=True)
        raise
    assert summary is not None
    # Only now: until the recording is whole, the raw files are all there is.
    if not arguments.keep_raw:
        for path in [*paths, *tables]:
            path.unlink(missing_ok=True)
    return {
        "path": str(out),
        "duration_us": summary.duration_us,
        "events": summary.events,
        "triggers": summary.triggers,
        "packets_dropped": {one.name: one.packets_dropped for one in takes},
        "events_left_out": {one.name: one.events_left_out for one in takes},
        "notes": list(summary.notes),
    }


def _losses(take: RawTake) -> list[str]:
    notes = []
    if take.packets_dropped or take.gaps:
        notes.append(
            f"Camera {take.name}: {take.packets_dropped:,} USB packets were lost in {take.gaps:,} gaps, this machine "
            f"being too busy; {take.events_left_out:,} events after them were left out."
        )
    if take.problem:
        notes.append(f"Camera {take.name} ended early: {take.problem}")
    return notes


def _describe(report: dict[str, object]) -> str:
    events, notes, duration_us = report["events"], report["notes"], report["duration_us"]
    assert isinstance(events, dict) and isinstance(notes, list) and isinstance(duration_us, int)
    lines = [f"{report['path']}: {duration_us / 1e6:.3f} s"]
    lines += [f"  {name}: {counted(count, 'event')}" for name, count in events.items()]
    frames = report.get("frames")
    if isinstance(frames, dict):
        lines += [f"  {name}: {counted(count, 'picture')}" for name, count in frames.items()]
    return "\n".join([*lines, *map("  {}".format, notes)])
