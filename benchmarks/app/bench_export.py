"""How long exports take and how large they are: ten seconds of two 1280x720 cameras."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from app.export.formats import FORMATS, ExportRequest, export
from benchmarks.machine import describe_machine, report_rows_to
from core.cameras import stereo_preset
from core.recordings import open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording

SECONDS: Final = 10
SERVES: Final = 13
"""A serve takes 0.83 s on average; what is over ten seconds is not exported."""
NOISE_HZ: Final = 0.1
SEED: Final = 3
STRIDE_US: Final = 4_000
SHARE_OF_SIMULATION: Final = 0.3


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """A row per format: seconds of wall time, CPU seconds of all processes that worked on it, megabytes.

    Serves at 5 m/s with truth, noise 0.1 Hz a pixel; 250 pictures a second and camera in the Rerun file, with the
    detector's stages.
    """
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as name:
        folder = Path(name)
        source = folder / "ten.h5"
        config = StereoConfig(sensor=SensorConfig(noise_hz=NOISE_HZ))
        serves = [LaunchConfig()] * SERVES
        simulate_recording(
            source, config, stereo_preset(), serves, seed=SEED,
            progress=lambda share: progress(SHARE_OF_SIMULATION * share),
        )  # fmt: skip
        with open_recording(source) as recording:
            end_us = min(recording.duration_us, SECONDS * 1_000_000)
            events = sum(len(one.slice(0, end_us)) for one in recording.cameras.values())
            kinds = {kind: about for kind, about in FORMATS.items() if about.of_recordings}
            for number, (kind, about) in enumerate(kinds.items()):
                stride_us = STRIDE_US if kind == "rrd" else None
                order = ExportRequest(format=kind, destination=folder / f"{kind}{about.suffix}", end_us=end_us,
                              stride_us=stride_us)  # fmt: skip
                started_s, cpu_s = time.perf_counter(), _cpu_s()
                files = export(order, recording=recording, groups=recording.read_rows)
                rows.append(
                    {
                        "format": kind,
                        "seconds": time.perf_counter() - started_s,
                        "cpu_s": _cpu_s() - cpu_s,
                        "megabytes": sum(path.stat().st_size for path in files) / 1e6,
                    }
                )
                share = SHARE_OF_SIMULATION + (1 - SHARE_OF_SIMULATION) * (number + 1) / len(kinds)
                report_rows_to(progress, rows[-1:], share)
    return {
        "rows": rows,
        "recording": {"seconds": end_us / 1e6, "cameras": "2 x 1280x720", "events": events, "noise_hz": NOISE_HZ},
        "machine": describe_machine("rerun-sdk", "viser"),
        "seed": SEED,
    }


def _cpu_s() -> float:
    """Processor time of this process and of those it started that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
