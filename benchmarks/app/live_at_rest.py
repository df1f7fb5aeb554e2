"""What the live rally costs while nobody watches it: shares of a core, with clients that draw nothing.

Read from /proc, so on Linux only.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from benchmarks.app.bare_browser import Visitor
from benchmarks.app.served_app import ServedApp, served
from benchmarks.machine import Row, goal_row
from core.cameras import stereo_preset
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording

CLIENTS: Final = 2
MEASURED_S: Final = 20.0
SETTLE_S: Final = 6.0
"""Longer than the rally runs on after the last one has turned away."""
PATIENCE_S: Final = 600.0
GOAL: Final = 0.05
"""Share of a core of the simulation at rest."""
RECORDING: Final = "beside"


def measure_rest(folder: Path, progress: Callable[[float], None] = lambda share: None) -> list[Row]:
    """Shares of a core of the simulation and the app: watched, with recordings open, in Train, without a client.

    The rally is the usual one (two cameras of 1280x720, a serve after the other), the clients are two.
    """
    make_recording(folder)
    rows = []
    with served(folder) as app:
        clients = [Visitor(app.port) for _ in range(CLIENTS)]
        for client in clients:
            client.wait_rally(PATIENCE_S)
        rows += _rows(app, f"{CLIENTS} clients watch it", goal=None)
        progress(0.25)
        for client in clients:
            client.change("Recording", RECORDING)
        rows += _rows(app, f"{CLIENTS} clients on a recording", goal=GOAL)
        progress(0.5)
        for client in clients:
            client.change("Recording", "live")
            client.trigger("Mode: Train")
        rows += _rows(app, f"{CLIENTS} clients in Train", goal=GOAL)
        progress(0.75)
        for client in clients:
            client.close()
        rows += _rows(app, "no client", goal=GOAL)
    progress(1.0)
    return rows


def make_recording(folder: Path) -> None:
    """Put a short recording into the workspace."""
    file = folder / "recordings" / f"{RECORDING}.h5"
    file.parent.mkdir(parents=True, exist_ok=True)
    simulate_recording(file, StereoConfig(sensor=SensorConfig()), stereo_preset(), [LaunchConfig()], seed=1)


def _rows(app: ServedApp, when: str, goal: float | None) -> list[Row]:
    time.sleep(SETTLE_S)
    simulation = app.simulation()
    assert simulation is not None
    pids = {"simulation": simulation, "app": app.process.pid}
    before, begun_s = {name: _cpu_s(pid) for name, pid in pids.items()}, time.monotonic()
    time.sleep(MEASURED_S)
    passed_s = time.monotonic() - begun_s
    shares = {name: (_cpu_s(pid) - before[name]) / passed_s for name, pid in pids.items()}
    limits = {"simulation": float("inf") if goal is None else goal, "app": float("inf")}
    note = f"load {os.getloadavg()[0]:.0f}"
    return [goal_row(f"{when}: {name}", share, limits[name], "cores", note=note) for name, share in shares.items()]


def _cpu_s(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
