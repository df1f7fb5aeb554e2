"""How smoothly the live rally runs and is shown: `python -m benchmarks.app.measure_live [SECONDS]`.

First without a browser: simulation, link and chain alone, for both sensor sizes. Then in headless Chromium, and prints
what the app's process did meanwhile: updates of the 3D scene and of the camera pictures per second, its share of a core
(link, chain, pictures, everything), and the simulation's pace. Chromium draws in software here and takes a core or more
of its own.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from app.modes.watch.mode import WatchMode
from app.scene.world import World
from app.server import App
from benchmarks.app.bare_browser import measuring_browser
from benchmarks.app.opened_rally import opened_rally, shown_rally, wait_until

SPEED_MPS = 5.0
SETTLE_S = 8.0
"""Until everything is compiled and loaded."""


def measure_alone(seconds: float, sensor: str) -> None:
    """Print one line about simulation and chain without a browser."""
    with opened_rally(SPEED_MPS, "--sensor", sensor) as live:
        time.sleep(SETTLE_S)
        began_us, cpu_s, wall_s = live.recording.duration_us, time.process_time(), time.monotonic()
        time.sleep(seconds)
        wall_s = time.monotonic() - wall_s
        share = (time.process_time() - cpu_s) / wall_s
        snapshot = live.player.snapshot
        health = snapshot.health
        print(
            f"{sensor}: {(live.recording.duration_us - began_us) / 1e6 / wall_s:.2f} x real time, {share:.2f} of a "
            f"core beside the simulation, chain {health.core_share:.2f} of a core, step p50 {health.step.p50_ms:.2f} "
            f"p99 {health.step.p99_ms:.1f} ms, block to command p50 {health.arrival_to_sent.p50_ms:.1f} p99 "
            f"{health.arrival_to_sent.p99_ms:.1f} ms, {snapshot.returned} of {snapshot.played} balls returned, "
            f"load {os.getloadavg()[0]:.1f}"
        )


def measure_shown(seconds: float) -> None:
    """Print one line about the rally in a browser."""
    with (
        tempfile.TemporaryDirectory() as folder,
        measuring_browser() as browser,
        shown_rally(browser, Path(folder), SPEED_MPS) as (live, lab),
    ):
        watch, world = first_watch(lab)
        time.sleep(SETTLE_S)
        draws, pictures = note_calls(world, "draw"), note_calls(watch._cameras, "show")
        paces = []
        cpu_s, wall_s = time.process_time(), time.monotonic()
        while time.monotonic() - wall_s < seconds:
            time.sleep(0.2)
            if live.state is not None:
                paces.append(live.state.real_time_factor)
        wall_s = time.monotonic() - wall_s
        share = (time.process_time() - cpu_s) / wall_s
        health = live.player.snapshot.health
        p50_ms, p99_ms = np.percentile(1e3 * np.diff(draws), (50, 99))
        print(
            f"{len(draws) / wall_s:.1f} updates/s (gap p50 {p50_ms:.0f}, p99 {p99_ms:.0f} ms), "
            f"{len(pictures) / wall_s:.1f} camera pictures/s, {share:.2f} of a core, "
            f"pace {np.median(paces):.2f} x real time, "
            f"chain {health.state_hz:.0f} Hz {health.core_share:.2f} of a core, "
            f"dropped {health.blocks_dropped} of {health.blocks + health.blocks_dropped} blocks, "
            f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
        )


def first_watch(lab: App) -> tuple[WatchMode, World]:
    """Watch of the first browser, once its 3D scene is there."""
    comes_up = lambda: bool(lab.sessions) and lab.sessions[0].world.visible  # noqa: E731
    wait_until(comes_up, "the live rally did not come up in the browser", where="measure_live")
    session = lab.sessions[0]
    watch = session._modes["Watch"]
    assert isinstance(watch, WatchMode)
    return watch, session.world


def note_calls(owner: object, name: str) -> list[float]:
    """When a method is called from now on, monotonic seconds."""
    times_s: list[float] = []
    method = getattr(owner, name)

    def noted(*given: object) -> object:
        times_s.append(time.monotonic())
        return method(*given)

    setattr(owner, name, noted)
    return times_s


if __name__ == "__main__":
    wanted_s = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    for size in ("1280x720", "1280x1280"):
        measure_alone(wanted_s, size)
    measure_shown(wanted_s)
