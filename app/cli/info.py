"""`rallyscope info`: what a recording, or an event file of any other format, holds, and its balls."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from app.cli.arguments import DATA, flag, given, positional
from app.cli.files import check_folder, csv_text, write_text
from app.cli.progress import progress_bar
from app.cli.terminal import format_table, json_ready, print_lines, say
from core.errors import CommandError
from core.extras import require_package
from core.recordings import CameraStream, open_recording
from core.recordings.reader import FileRecording
from core.text import counted

Facts = dict[str, object]
SHOWN: Final = 20
"""Balls that are printed for a person; `--out` has all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InfoArguments:
    """Show what a recording, or an event file of any other format, holds."""

    recording: Path = positional(
        "recording or event file to show; with --balls also a workspace, data set or run", "REC"
    )
    balls: bool = flag("list every flight, bounce and stroke instead")
    where: str | None = flag(
        "only balls that meet all conditions, such as 'kind=stroke speed_mps=5..7 outcome=net|out'", "CONDITIONS"
    )
    track: bool = flag("let the tracker find the balls of recordings that say nothing of them; it takes long")
    out: Path | None = flag("write these balls as a table", "FILE.csv")
    to: Path | None = flag("write the flights and strokes of these balls for `train --balls FILE`", "FILE.json")
    data_set: Path | None = flag("write the flights of these balls, with labels or the truth, as a data set", "DIR")
    data: Path = flag("data set: workspace with the labels, unless REC is one", "DIR", DATA)
    json: bool = flag("print it as JSON")


def run(arguments: InfoArguments) -> None:
    """Print what is there."""
    if arguments.balls:
        _list_balls(arguments)
        return
    if wrong := given(
        {
            "--where": arguments.where,
            "--track": arguments.track or None,
            "--out": arguments.out,
            "--to": arguments.to,
            "--data-set": arguments.data_set,
        }
    ):
        raise CommandError("only balls have that", got=", ".join(wrong), remedy="add --balls")
    with progress_bar(f"Reading {arguments.recording.name}") as progress:
        recording = open_recording(arguments.recording, progress=progress)
    with closing(recording):
        facts = recording_facts(recording)
        lines = [str(arguments.recording), *_lines(recording, facts)]
        if arguments.json:
            say(json.dumps({"path": lines[0], **facts}))
        else:
            print_lines(lines)


def _list_balls(arguments: InfoArguments) -> None:
    """The balls of a recording, a run, or all of a folder; in a workspace they are indexed, and read from there."""
    require_package("pyarrow", "the index of balls")
    from app.export.flight_set import write_flight_set
    from app.shared.ball_index import ball_sources, index_balls
    from labels.balls.launches import write_launches
    from labels.balls.table import COLUMNS, STATE, parse_conditions, select_rows

    check_folder(arguments.out)
    check_folder(arguments.to, "--to")
    check_folder(arguments.data_set, "--data-set")
    conditions = parse_conditions(arguments.where or "")
    place = arguments.recording
    sources = ball_sources(place)
    if not sources:
        expected = "a recording, or a folder with recordings or runs"
        raise CommandError("no balls to list", expected=expected, where=place)
    workspace = place if (place / "recordings").is_dir() else None
    with progress_bar("Indexing balls") as progress:
        found = index_balls(sources, workspace, track=arguments.track, progress=progress)
    chosen = select_rows(found.table, conditions)
    selected = found.table.take(chosen)
    rows = selected.to_pylist()
    if arguments.out is not None:
        write_text(arguments.out, csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in rows)))
    written = None if arguments.to is None else write_launches(arguments.to, selected)
    made = None
    if arguments.data_set is not None:
        asked = (arguments.where or "").strip()
        how = f"conditions {asked}" if asked else "all balls"
        with progress_bar(f"Writing {arguments.data_set.name}") as progress:
            labels = (workspace or arguments.data) / "labels"
            made = write_flight_set(found, chosen, labels, arguments.data_set, selected_by=how, progress=progress)
    unknown = [str(source.path) for source in found.unknown]
    if arguments.json:
        facts: Facts = {"path": str(place), "balls": rows, "unknown": unknown, "failed": found.failed}
        if made is not None:
            facts["data_set"] = {"path": str(made.folder), "selection": made.manifest["selection"]}
        say(json.dumps(json_ready(facts)))
        return
    if rows:
        say(format_table(selected.drop_columns(list(STATE)).slice(0, SHOWN).to_pylist()))
    print_lines(
        [f"{len(rows):,} of {len(found.table):,} balls", *(f"not read: {text}" for text in found.failed.values())]
    )
    if written is not None:
        launches = counted(written.written, "launch")
        say(f"{launches} in {arguments.to}, {written.unknown:,} left out: their state is not known")
    if made is not None:
        say(str(made))
    print_lines(f"nothing is known of the balls of {path}: --track finds them" for path in unknown)


def recording_facts(recording: FileRecording) -> Facts:
    """What the JSON output holds."""
    ball = recording.ball
    return {
        "uuid": recording.uuid,
        "duration_us": recording.duration_us,
        "seed": recording.seed,
        "cameras": {name: _camera_facts(stream, recording.duration_us) for name, stream in recording.cameras.items()},
        "ball_truth_samples": 0 if ball is None else len(ball.t_us),
        "frames": {name: len(frames) for name, frames in recording.frames.items()},
        "groups": list(recording.groups),
        "notes": list(recording.notes),
    }


def _camera_facts(stream: CameraStream, duration_us: int) -> Facts:
    counts = stream.counts_per_ms()
    smooth = np.convolve(counts, np.ones(min(10, max(1, len(counts)))), "valid") if len(counts) else np.zeros(1)
    truth = stream.truth
    return {
        "width_px": stream.sensor.width_px,
        "height_px": stream.sensor.height_px,
        "events": stream.event_count,
        "mean_rate_hz": stream.event_count * 1e6 / max(duration_us, 1),
        "peak_rate_hz": float(smooth.max()) * 1000 / min(10, max(1, len(counts))),
        "triggers": len(stream.triggers.t_us),
        "calibrated": stream.calibration is not None,
        "truth_samples": 0 if truth is None else len(truth.t_us),
    }


def _lines(recording: FileRecording, facts: Facts) -> list[str]:
    lines = [f"  duration     {recording.duration_us / 1e6:.6f} s", f"  uuid         {recording.uuid}"]
    if recording.seed is not None:
        lines.append(f"  seed         {recording.seed}")
    for name, stream in recording.cameras.items():
        lines += [f"  camera {name}: {stream.sensor}", *_camera_lines(_camera_facts(stream, recording.duration_us))]
    if recording.ball is not None:
        lines.append(f"  ball truth   {facts['ball_truth_samples']:,} samples")
    lines += [f"  frames {name}: {len(frames):,}" for name, frames in recording.frames.items()]
    return lines + [f"  note: {note}" for note in recording.notes]


def _camera_lines(facts: Facts) -> list[str]:
    mean, peak = (float(str(facts[name])) / 1e6 for name in ("mean_rate_hz", "peak_rate_hz"))
    return [
        f"    events       {facts['events']:,}",
        f"    rate         {mean:.3f} million/s on average, {peak:.3f} million/s in the busiest 10 ms",
        f"    triggers     {facts['triggers']:,} edges",
        f"    calibration  {'yes' if facts['calibrated'] else 'no'}",
        f"    truth        {facts['truth_samples']:,} samples",
    ]
