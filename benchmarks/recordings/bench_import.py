"""Speed and memory of imports, and of slices out of a long recording.

The events are uniformly random on 1280x720 at 5 million a second, the hardest to pack. Files are warm (just written).
Each import runs in a process of its own, so that its peak of memory is its own; its speed is wall time of the import,
without the start of Python. The figure of a slice is wall time too, most of its blocks not yet decoded. Decoding alone
is measured against faery's, run by run in turn in one process.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from faery import evt
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, report_rows_to
from core.events import SensorSize
from core.recordings import open_recording
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport
from core.text import parse_json

SENSOR: Final = SensorSize(1280, 720)
RATE_PER_US: Final = 5
SHORT_EVENTS: Final = 20_000_000
LONG_EVENTS: Final = 100_000_000
SLICE_US: Final = 50_000
SLICES: Final = 200
DECODE_RUNS: Final = 7
EVT3_HEADER: Final = f"% evt 3.0\n% format EVT3;height={SENSOR.height_px};width={SENSOR.width_px}\n% end\n".encode()
TRIGGER_EVENTS: Final = 2500
"""From one trigger edge to the next: 500 us."""

_IMPORT: Final = """
import json, re, sys, time
from pathlib import Path
from core.recordings import ImportOrder, import_recording
import_recording(ImportOrder([Path(sys.argv[1])]), Path(sys.argv[3]))
started, started_cpu = time.perf_counter(), time.process_time()
summary = import_recording(ImportOrder([Path(sys.argv[2])]), Path(sys.argv[4]), overwrite=True)
seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - started_cpu
peak_mb = int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text("utf-8"))[1]) / 1024
print(json.dumps({"seconds": seconds, "cpu_seconds": cpu_seconds, "peak_mb": peak_mb,
                  "events": sum(summary.events.values()), "triggers": sum(summary.triggers.values())}))
"""
"""Imports a tiny file first: the compiled loops are read from their cache once per process. The peak is that of Linux's
own books: getrusage would count the memory of the process that started this one."""

Report = dict[str, object]


def run(progress: Callable[[float], None]) -> Report:
    """Rows of measure, events, median, worst, unit, runs and target; and the machine."""
    rows: list[Report] = []
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as name:
        folder = Path(name)
        tiny = folder / "tiny.raw"
        write_evt3(tiny, 10_000)
        recording = folder / "recording.h5"
        for events, runs, share in ((SHORT_EVENTS, 5, 0.3), (LONG_EVENTS, 3, 0.8)):
            source = folder / "source.raw"
            write_evt3(source, events)
            measured = [import_apart(tiny, source, recording) for _ in range(runs)]
            source.unlink()
            found = _import_rows(measured, events)
            rows += found
            report_rows_to(progress, found, share)
        rows.append(_slice_row(recording))
        write_evt3(tiny, SHORT_EVENTS // 2)
        rows += _decode_rows(tiny)
        progress(1.0)
    return {"rows": rows, "machine": describe_machine("h5py", clock="wall time, files warm")}


def write_evt3(path: Path, count: int) -> None:
    """An EVT3 file of random events with an edge on trigger input 1 about every 500 us."""
    rng = np.random.default_rng(0)
    size = min(count, 1_000_000)
    duration_us = size // RATE_PER_US
    with path.open("wb") as file:
        file.write(EVT3_HEADER)
        for number in range(count // size):
            t_us = np.sort(rng.integers(0, duration_us, size)) + 10_000 + number * duration_us
            file.write(evt3_words(t_us, rng).tobytes())


def evt3_words(t_us: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.uint16]:
    """Random events at these times, of each those of five words that it needs: two of time, trigger, row, column."""
    size = len(t_us)
    words = np.empty((size, 5), np.uint16)
    words[:, 0] = 0x8000 | t_us >> 12 & 0xFFF
    words[:, 1] = 0x6000 | t_us & 0xFFF
    words[:, 2] = 0xA100 | np.arange(size) // TRIGGER_EVENTS & 1
    words[:, 3] = rng.integers(0, SENSOR.height_px, size)
    words[:, 4] = 0x2000 | rng.integers(0, 2, size) << 11 | rng.integers(0, SENSOR.width_px, size)
    needed = np.ones((size, 5), np.bool_)
    needed[1:, 0] = words[1:, 0] != words[:-1, 0]
    needed[1:, 1] = words[1:, 1] != words[:-1, 1]
    needed[:, 2] = np.arange(size) % TRIGGER_EVENTS == 0
    return words[needed]


def import_apart(tiny: Path, source: Path, recording: Path) -> dict[str, float]:
    """Import in a process of its own; its seconds, cpu_seconds, peak_mb, events and triggers."""
    recording.unlink(missing_ok=True)
    warm_up = recording.with_suffix(".tiny.h5")
    warm_up.unlink(missing_ok=True)
    words = [sys.executable, "-c", _IMPORT, str(tiny), str(source), str(warm_up), str(recording)]
    return parse_json(subprocess.run(words, capture_output=True, encoding="utf-8", check=True).stdout)


def _import_rows(measured: list[dict[str, float]], events: int) -> list[Report]:
    if any(one["events"] != events for one in measured):
        raise AssertionError(f"an import lost events: {measured}")
    rates = [one["events"] / one["seconds"] / 1e6 for one in measured]
    cpu = [one["cpu_seconds"] / one["events"] * 1e9 for one in measured]
    peaks = [one["peak_mb"] for one in measured]
    expected = events // TRIGGER_EVENTS
    kept = [one["triggers"] / expected for one in measured]
    return [
        _row("EVT3 import", events, rates, min(rates), "million events/s", ">= 20"),
        _row("EVT3 import, CPU", events, cpu, max(cpu), "ns/event", "-"),
        _row("EVT3 import, peak memory", events, peaks, max(peaks), "MB", "<= 300"),
        _row("EVT3 import, triggers kept", events, kept, min(kept), "share", "1"),
    ]


def _slice_row(path: Path) -> Report:
    with open_recording(path) as recording:
        (camera,) = recording.cameras.values()
        starts = np.random.default_rng(1).integers(0, recording.duration_us - SLICE_US, SLICES).tolist()
        camera.slice(0, SLICE_US)
        spent: list[float] = []
        for start_us in starts:
            started = time.perf_counter()
            camera.slice(start_us, start_us + SLICE_US)
            spent.append((time.perf_counter() - started) * 1e3)
        return _row("50 ms slice", camera.event_count, spent, max(spent), "ms", "<= 15")


def _decode_rows(path: Path) -> list[Report]:
    """Our reader and faery's in turn: million events/s of each, and the ratio of each pair."""
    ours: list[float] = []
    theirs: list[float] = []
    events = _decode(path)
    if _decode_with_faery(path) != events:
        raise AssertionError("faery finds another number of events")
    for _ in range(DECODE_RUNS):
        for decode, rates in ((_decode, ours), (_decode_with_faery, theirs)):
            started = time.perf_counter()
            decode(path)
            rates.append(events / (time.perf_counter() - started) / 1e6)
    ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
    return [
        _row("EVT3 decoding", events, ours, min(ours), "million events/s", "-"),
        _row("EVT3 decoding by faery", events, theirs, min(theirs), "million events/s", "-"),
        _row("EVT3 decoding, ours to faery's", events, ratios, min(ratios), "ratio", ">= 1"),
    ]


def _decode(path: Path) -> int:
    (source,) = open_sources(path)
    return sum(len(part) for part in source.read(DecodeReport()))


def _decode_with_faery(path: Path) -> int:
    events = 0
    with evt.Decoder(path, None, None) as decoder:
        for packet in decoder:
            events += len(packet["events"]) if "events" in packet else 0
    return events


def _row(measure: str, events: int, values: list[float], worst: float, unit: str, target: str) -> Report:
    return {
        "measure": measure,
        "events": events,
        "median": float(np.median(values)),
        "worst": float(worst),
        "unit": unit,
        "runs": len(values),
        "target": target,
    }
