"""How smoothly the live rally runs and is shown: `python tests/app/browser/measure_live.py [SECONDS]`.

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
from conftest import FLAGS, Window, wait_for
from playwright.sync_api import sync_playwright

from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, SimulationProcess, join_simulation
from app.shared.workspace import Workspace


def measure_alone(seconds: float, sensor: str) -> None:
    """Print one line about simulation and chain without a browser."""
    process = SimulationProcess("--auto-serve", "5", "--sensor", sensor)
    live = join_simulation(process.wait(), process=process)
    time.sleep(6.0)
    began_us, cpu_s, wall_s = live.recording.duration_us, time.process_time(), time.monotonic()
    time.sleep(seconds)
    wall_s = time.monotonic() - wall_s
    share = (time.process_time() - cpu_s) / wall_s
    snapshot = live.player.snapshot
    health = snapshot.health
    print(
        f"{sensor}: {(live.recording.duration_us - began_us) / 1e6 / wall_s:.2f} x real time, {share:.2f} of a core "
        f"beside the simulation, chain {health.core_share:.2f} of a core, step p50 {health.step.p50_ms:.2f} p99 "
        f"{health.step.p99_ms:.1f} ms, block to command p50 {health.arrival_to_sent.p50_ms:.1f} p99 "
        f"{health.arrival_to_sent.p99_ms:.1f} ms, {snapshot.returned} of {snapshot.played} balls returned, "
        f"load {os.getloadavg()[0]:.1f}"
    )
    live.close()


def measure_shown(seconds: float) -> None:
    """Print one line about the rally in a browser."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        process = SimulationProcess("--auto-serve", "5")
        live = join_simulation(process.wait(), process=process)
        workspace = Workspace(Path(folder))
        lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=FLAGS)
        window = Window(browser.new_page(viewport={"width": 1280, "height": 720}), lab, in_space=True)
        world, cameras = window.session.world, window.session._modes["Watch"]._cameras
        wait_for(lambda: world.visible, "the 3D scene")
        time.sleep(8.0)  # everything is compiled and loaded
        draws, pictures, paces = [], [], []
        draw, show = world.draw, cameras.show
        world.draw = lambda picture: (draws.append(time.monotonic()), draw(picture))
        cameras.show = lambda pngs: (pictures.append(time.monotonic()), show(pngs))
        cpu_s, wall_s = time.process_time(), time.monotonic()
        while time.monotonic() - wall_s < seconds:
            time.sleep(0.2)
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
        browser.close()
        lab.stop()


if __name__ == "__main__":
    wanted_s = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    for size in ("1280x720", "1280x1280"):
        measure_alone(wanted_s, size)
    measure_shown(wanted_s)
