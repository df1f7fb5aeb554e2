"""Speed of the simulated event cameras: both cameras of a pair, on one core and as they are shipped.

On one core the cameras take turns and the clock is the CPU time of the one thread that works, so that other programs
count only by what they take of caches and clock rate. As shipped (`simulate_stereo`) each camera has a thread and the
clock is the wall's: that figure needs an idle machine, and the report has the load. Serves of one speed follow each
other; the pauses between them, about a third of the time, count too. Setting up the cameras (casting the background,
drawing the thresholds) is measured on its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.machine import describe_machine, report_rows_to, within
from core.cameras import stereo_preset
from core.cameras.presets import SENSOR_720, SENSOR_1280
from core.events import SensorSize
from core.simulation.bodies import MovingBodies, make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera, StereoConfig, simulate_stereo
from core.simulation.flights import FlightSeries, LaunchConfig
from core.simulation.scenes.scene import scene_named
from core.simulation.sensor.sensor import SensorConfig

SERVES: Final = 3
SEED: Final = 7
RUNS: Final = 3
LONGEST_US: Final = 4_000_000
"""Rallies go on for longer; so much of them is simulated."""


@dataclass(frozen=True, slots=True)
class SpeedCase:
    """What is measured in one row."""

    scene: str
    sensor: SensorSize
    speed_mps: float
    noise_hz: float


CASES: Final = (
    SpeedCase("ball", SENSOR_720, 5.0, 0.1),
    SpeedCase("ball", SENSOR_720, 5.0, 1.0),
    SpeedCase("ball", SENSOR_720, 5.0, 5.0),
    SpeedCase("dark", SENSOR_720, 5.0, 0.1),
    SpeedCase("ball", SENSOR_1280, 5.0, 0.1),
    SpeedCase("ball", SENSOR_1280, 5.0, 1.0),
    SpeedCase("ball", SENSOR_1280, 9.0, 0.1),
    SpeedCase("person", SENSOR_720, 5.0, 0.1),
    SpeedCase("two-persons", SENSOR_720, 5.0, 0.1),
    SpeedCase("rally", SENSOR_720, 5.0, 0.1),
    SpeedCase("head", SENSOR_720, 5.0, 0.1),
)


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """A row per case, and the machine. Speeds are simulated seconds, of both cameras at once, per second of a clock."""
    measure_simulation(SpeedCase("ball", SensorSize(64, 64), 5.0, 0.1), serves=1)  # compile, or read the compiled code
    rows: list[dict[str, object]] = []
    for number, case in enumerate(CASES):
        part = within(progress, number / len(CASES), (number + 1) / len(CASES))
        rows.append(measure_simulation(case, progress=part))
        report_rows_to(progress, rows[-1:], (number + 1) / len(CASES))
    clock = f"CPU time of one thread, and wall time with a thread per camera; median and slowest of {RUNS} runs"
    return {"rows": rows, "machine": describe_machine("numba", "numpy", clock=clock)}


def measure_simulation(
    case: SpeedCase, *, serves: int = SERVES, progress: Callable[[float], None] = lambda share: None
) -> dict[str, object]:
    """Measure one setting: one row of the report."""
    balls = [LaunchConfig(speed_mps=case.speed_mps)] * serves
    path, strokes = draw_flights(scene_named(case.scene), balls, np.random.default_rng(SEED))
    bodies = make_actors(scene_named(case.scene).cast, SEED, strokes)
    end_us = min(int(np.ceil(path.end_s * 1e6 / BLOCK_US)) * BLOCK_US, LONGEST_US)
    turns: list[tuple[int, float, float]] = []
    walls_s: list[float] = []
    for run in range(RUNS):
        turns.append(_take_turns(case, path, bodies, end_us))
        progress((run + 0.6) / RUNS)
        walls_s.append(_wall_s(case, path, bodies, end_us))
        progress((run + 1) / RUNS)
    events, cpus_s, setups_s = zip(*turns, strict=True)
    return {
        "scene": case.scene,
        "sensor": str(case.sensor),
        "speed_mps": case.speed_mps,
        "noise_hz": case.noise_hz,
        "simulated_s": end_us * 1e-6,
        "events_per_s": round(events[0] / (end_us * 1e-6)),
        "one_core": end_us * 1e-6 / float(np.median(cpus_s)),
        "one_core_slowest": end_us * 1e-6 / max(cpus_s),
        "wall": (end_us - BLOCK_US) * 1e-6 / float(np.median(walls_s)),
        "wall_slowest": (end_us - BLOCK_US) * 1e-6 / max(walls_s),
        "setup_s": float(np.median(setups_s)),
    }


def _take_turns(
    case: SpeedCase, path: FlightSeries, bodies: MovingBodies | None, end_us: int
) -> tuple[int, float, float]:
    """Both cameras in this thread: events, and the seconds of CPU time with them and of setting them up."""
    config = _config(case)
    started_s = time.thread_time()
    rigs = [
        EventCamera(camera, config.scene, config.sensor, np.random.default_rng(SEED + index), bodies)
        for index, camera in enumerate(stereo_preset(sensor=case.sensor).values())
    ]
    ready_s = time.thread_time()
    events = 0
    for now_us in range(BLOCK_US, end_us + 1, BLOCK_US):
        for rig in rigs:
            events += len(rig.advance(path, now_us))
    return events, time.thread_time() - ready_s, ready_s - started_s


def _wall_s(case: SpeedCase, path: FlightSeries, bodies: MovingBodies | None, end_us: int) -> float:
    """Seconds that `simulate_stereo` takes from its first chunk, with which the cameras are set up, to its last."""
    cameras = stereo_preset(sensor=case.sensor)
    chunks = simulate_stereo(_config(case), cameras, path, seed=SEED, duration_us=end_us, bodies=bodies)
    next(chunks)
    started_s = time.perf_counter()
    for _ in chunks:
        pass
    return time.perf_counter() - started_s


def _config(case: SpeedCase) -> StereoConfig:
    return StereoConfig(scene=scene_named(case.scene), sensor=SensorConfig(noise_hz=case.noise_hz))
