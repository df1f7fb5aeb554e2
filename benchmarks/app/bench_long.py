"""One very long recording: imported, opened, looked at anywhere, and scored as far as somebody waits for it.

Its events are uniformly random on 1280x720 at 5 million a second, the hardest to pack; after 16.8 s, where the clock of
EVT3 begins anew, they repeat. The import runs in a process of its own; opening and pictures are wall time in this one,
with the file as the import has left it in the system's memory. Everything is deleted afterwards.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from app.state.client_state import RenderSettings, TuneView
from app.views.answer_cache import AnswerCache
from app.views.requests import TuneRequest, WatchRequest, answer_request
from benchmarks.app.soak.process_usage import usage_of
from benchmarks.machine import Row, describe_machine, goal_row
from benchmarks.partial_rows import report_rows_to
from benchmarks.recordings.bench_import import EVT3_HEADER, RATE_PER_US, evt3_words, import_apart, write_evt3
from core.detection import DetectorConfig, FastDetector
from core.detection.saved import SavedDetector
from core.metrics.run import run_detector
from core.recordings import Recording, open_recording

COUNT: Final = 1_000_000_000
CLOCK_US: Final = 1 << 24
"""After so long the clock of EVT3 begins anew."""
TURN_EVENTS: Final = CLOCK_US * RATE_PER_US
PIECE_EVENTS: Final = 1_000_000
OPENINGS: Final = 5
PICTURES: Final = 100
WINDOW_US: Final = 2000
SCORED_S: Final = 20.0
"""Somebody waits so long for a score, and gives up."""
SEED: Final = 16


def run(progress: Callable[[float], None], *, count: int = COUNT) -> dict[str, object]:
    """Rows of a recording of so many events, each with its goal."""
    rows: list[Row] = []

    def tell(found: list[Row], share: float) -> None:
        rows.extend(found)
        report_rows_to(progress, found, share)

    with tempfile.TemporaryDirectory(prefix="rallyscope-long-") as name:
        folder = Path(name)
        source, file = folder / "long.raw", folder / "long.h5"
        write_long_evt3(source, count)
        progress(0.2)
        tell(import_rows(source, file, whole_turns(count)), 0.6)
        source.unlink()
        tell(opening_rows(file), 0.7)
        with open_recording(file) as recording:
            tell(scrub_rows(recording), 0.9)
            tell(score_rows(recording, SCORED_S), 1.0)
    return {"rows": rows, "machine": describe_machine("h5py", clock="wall time, files warm"), "seed": SEED}


def whole_turns(count: int) -> int:
    """So many events, or as many more as fill the last turn of the clock."""
    return count if count <= TURN_EVENTS else -(-count // TURN_EVENTS) * TURN_EVENTS


def write_long_evt3(path: Path, count: int) -> None:
    """An EVT3 file of `whole_turns(count)` events: one turn of its clock, again and again."""
    rng = np.random.default_rng(SEED)
    first = min(TURN_EVENTS, count)
    with path.open("wb") as file:
        file.write(EVT3_HEADER)
        for done in range(0, first, PIECE_EVENTS):
            size = min(PIECE_EVENTS, first - done)
            t_us = np.sort(rng.integers(int(done / RATE_PER_US), int((done + size) / RATE_PER_US), size))
            file.write(evt3_words(t_us, rng).tobytes())
        file.flush()
        turn = np.memmap(path, np.uint8, "r", len(EVT3_HEADER))
        for _ in range(1, whole_turns(count) // TURN_EVENTS):
            file.write(turn.data)


def import_rows(source: Path, file: Path, count: int) -> list[Row]:
    """How fast, and with how much memory."""
    tiny = source.with_name("tiny.raw")
    write_evt3(tiny, 10_000)
    found = import_apart(tiny, source, file)
    if found["events"] != count:
        raise AssertionError(f"the import lost events: {found}")
    note = f"{source.stat().st_size / 1e9:.1f} GB of EVT3, {file.stat().st_size / 1e9:.1f} GB of HDF5"
    return [
        goal_row(
            f"import of {count / 1e6:.0f} million events",
            count / found["seconds"] / 1e6, 10, "million/s", least=True, note=note,
        ),
        goal_row("import, per second of a core", count / found["cpu_seconds"] / 1e6, 10, "million/s", least=True),
        goal_row("import, peak memory", found["peak_mb"], 400, "MB"),
    ]  # fmt: skip


def opening_rows(file: Path) -> list[Row]:
    """How long it takes until its first events are there."""
    seconds = []
    for _ in range(OPENINGS):
        began_s = time.perf_counter()
        with open_recording(file) as recording:
            for stream in recording.cameras.values():
                stream.counts_per_ms()
                stream.slice(0, WINDOW_US)
        seconds.append(time.perf_counter() - began_s)
    return [goal_row("opening", max(seconds), 3, "s", note=f"slowest of {OPENINGS}, median {np.median(seconds):.2f} s")]


def scrub_rows(recording: Recording) -> list[Row]:
    """Pictures at random times of it."""
    (stream,) = recording.cameras.values()
    look, config, kept = RenderSettings(), DetectorConfig(), AnswerCache()
    views: dict[str, Callable[[int], TuneRequest | WatchRequest]] = {
        "Watch": lambda t_us: WatchRequest(recording, t_us, look, SavedDetector("auto", config), True),
        "Tune": lambda t_us: TuneRequest(stream, t_us, look, TuneView(method="auto"), (("A", config),), kept),
    }
    rng = np.random.default_rng(SEED)
    rows = []
    for view, request in views.items():
        ms = []
        for number in range(-5, PICTURES):  # the first ones load code and are not counted
            wanted = request(int(rng.integers(WINDOW_US, recording.duration_us)))
            began_s = time.perf_counter()
            answer_request(wanted)
            if number >= 0:
                ms.append(1e3 * (time.perf_counter() - began_s))
        note = f"median {np.median(ms):.0f} ms, {PICTURES} pictures"
        rows.append(goal_row(f"a picture of {view} anywhere, p95", float(np.percentile(ms, 95)), 150, "ms", note=note))
    return rows


def score_rows(recording: Recording, wait_s: float) -> list[Row]:
    """A detector over all of it, given up after a while: does it tell how far it is, end at once, stay small?"""
    (stream,) = recording.cameras.values()
    detector = FastDetector(DetectorConfig())
    before_mb, began_s, asked_s = own_mb(), time.perf_counter(), 0.0
    shares: list[float] = []

    def cancelled() -> bool:
        nonlocal asked_s
        if not asked_s and time.perf_counter() - began_s > wait_s:
            asked_s = time.perf_counter()
        return bool(asked_s)

    run_detector(stream, detector, WINDOW_US, progress=shares.append, cancelled=cancelled)
    ended_s = time.perf_counter()
    forward = bool(shares) and shares == sorted(shares) and shares[-1] > 0
    reached = shares[-1] if shares else 0.0
    spent_s = ended_s - began_s
    note = f"{reached:.1%} in {spent_s:.0f} s, {reached * stream.event_count / 1e6 / spent_s:.1f} million events/s"
    return [
        goal_row("scoring tells how far it is", float(forward), 1, "", least=True, note=note),
        goal_row("scoring ends after Cancel within", ended_s - (asked_s or ended_s), 1, "s"),
        goal_row("memory that scoring takes", own_mb() - before_mb, 100, "MB"),
    ]


def own_mb() -> float:
    """Megabytes that belong to this process alone."""
    return usage_of(os.getpid()).resident_mb
