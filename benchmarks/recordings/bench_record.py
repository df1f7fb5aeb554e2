"""What `rallyscope record` keeps of a camera that sends 20 million events a second, for a minute by default.

No camera is needed: what its bytes would be is made in this process, which costs about as much as recording them, and
comes through the driver's own packets and a ring of 4,096 of them (of 1 ms; 4 s) that overflows as the driver's does.
Every event is accounted for: it is in the recording, or was in a packet that found no room, or was left out after one.
Events are uniformly random on 1280x720. The files (5 GB a minute of RAW, and the recording) go to the temporary folder.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.machine import describe_machine, goal_row
from benchmarks.partial_rows import report_rows_to
from core.devices.neuromorphic import open_camera
from core.devices.raw_recorder import RawRecorder
from core.devices.replayed_hardware import Replayed, ReplayedLibrary
from core.events import Events, SensorSize
from core.events.events import concatenate_events
from core.recordings import import_recording

SENSOR: Final = SensorSize(1280, 720)
RATE_HZ: Final = 20_000_000
SECONDS: Final = 60
ROUND_US: Final = 100_000
SERIAL: Final = "bench"

Report = dict[str, object]


class DrawnRound:
    """The same random events every tenth of a second."""

    sensor = SENSOR

    def __init__(self, rate_hz: int) -> None:
        rng, count = np.random.default_rng(0), rate_hz * ROUND_US // 1_000_000
        t_us = np.sort(rng.integers(0, ROUND_US, count))
        x_px, y_px = rng.integers(0, SENSOR.width_px, count), rng.integers(0, SENSOR.height_px, count)
        self._round = Events.from_columns(t_us, x_px, y_px, rng.random(count) < 0.5, SENSOR)

    def slice(self, start_us: int, end_us: int) -> Events:
        """Of one round after the other."""
        later_us = start_us // ROUND_US * ROUND_US
        parts, at_us = [], start_us
        while at_us < end_us:
            until_us = min(end_us, later_us + ROUND_US)
            seen = self._round.between(at_us - later_us, until_us - later_us)
            parts.append(Events(seen.t_us + later_us, seen.x_px, seen.y_px, seen.on, SENSOR))
            at_us, later_us = until_us, later_us + ROUND_US
        if len(parts) == 1:
            return parts[0]
        return concatenate_events(parts, SENSOR)


def run(progress: Callable[[float], None], count: int | None = None) -> Report:
    """Rows of what was kept, lost and unaccounted for, with goals; `count` is the number of seconds."""
    seconds = count or SECONDS
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as name:
        rows = measure_recording(Path(name), seconds, RATE_HZ, progress)
    report_rows_to(progress, rows, 1.0)
    return {"rows": rows, "machine": describe_machine("neuromorphic-drivers", clock="wall time")}


def measure_recording(folder: Path, seconds: int, rate_hz: int, progress: Callable[[float], None]) -> list[Report]:
    """Record for so long, make the recording, and count."""
    out = folder / "recording.h5"
    camera = Replayed(stream=DrawnRound(rate_hz), duration_us=seconds * 1_000_000)
    library = ReplayedLibrary({SERIAL: camera}, hold=True)
    device = open_camera(SERIAL, raw=True, driver=library)
    recorder = RawRecorder({"camera": device}, out)
    began_cpu_s = time.process_time()
    library.begin()
    pause = threading.Event()
    while library.opened[0].sent_us < seconds * 1_000_000 and not recorder.over:
        pause.wait(0.2)
        progress(0.6 * library.opened[0].sent_us / (seconds * 1e6))
    cpu_s = time.process_time() - began_cpu_s
    (take,) = recorder.stop()
    if take.problem:
        raise AssertionError(take.problem)
    since_s = time.monotonic()
    summary = import_recording([take.path], out, progress=lambda share: progress(0.6 + 0.4 * share))
    made_s = time.monotonic() - since_s
    assert summary is not None
    kept, offered = summary.events["camera"], seconds * rate_hz
    lost = library.opened[0].events_dropped + take.events_left_out
    what = f"{rate_hz / 1e6:g} M events/s for {seconds} s"
    mb = take.path.stat().st_size / 1e6
    return [
        goal_row(f"{what}: kept", 100.0 * kept / offered, 100.0, "%", least=True, note=f"{mb:.0f} MB of RAW"),
        goal_row(f"{what}: neither kept nor counted as lost", abs(offered - kept - lost), 0, "events"),
        {"what": f"{what}: lost", "measured": float(lost), "unit": "events", "note": f"{take.packets_dropped} packets"},
        {
            "what": "processor, with the making of the bytes", "measured": round(cpu_s / seconds, 2), "unit": "cores",
            "note": "while it was recorded",
        },
        {"what": "made into a recording", "measured": round(kept / made_s / 1e6, 1), "unit": "M events/s"},
    ]  # fmt: skip
