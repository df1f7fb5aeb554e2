"""Speed of the simulated event cameras: both cameras of a pair, one after the other, on one core.

The clock is the CPU time of the one thread that works, so that other load on the machine does not count. Serves of one
speed follow each other; the pauses between them, about a third of the time, count too. Setting up a camera (casting the
background, drawing the thresholds) is measured on its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from core.cameras import stereo_preset
from core.cameras.presets import SENSOR_720, SENSOR_1280
from core.evaluation.machine import describe_machine
from core.events import SensorSize
from core.simulation.event_camera import BLOCK_US, EventCamera
from core.simulation.scene import scene_named
from core.simulation.sensor import SensorConfig
from core.simulation.serve import ServeConfig
from core.simulation.serves import draw_serves

SERVES: Final = 3
SEED: Final = 7


@dataclass(frozen=True, slots=True)
class Case:
    """What is measured in one row."""

    scene: str
    sensor: SensorSize
    speed_mps: float
    noise_hz: float


CASES: Final = (
    Case("ball", SENSOR_720, 5.0, 0.1),
    Case("ball", SENSOR_720, 5.0, 1.0),
    Case("ball", SENSOR_720, 5.0, 5.0),
    Case("dark", SENSOR_720, 5.0, 0.1),
    Case("ball", SENSOR_1280, 5.0, 0.1),
    Case("ball", SENSOR_1280, 5.0, 1.0),
    Case("ball", SENSOR_1280, 9.0, 0.1),
)


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """A row per case, and the machine. `real_time` is simulated seconds per second of one core, both cameras."""
    measure(Case("ball", SensorSize(64, 64), 5.0, 0.1), serves=1)  # compile, or read the compiled code
    rows: list[dict[str, object]] = []
    for case in CASES:
        rows.append(measure(case))
        progress(len(rows) / len(CASES))
    return {"rows": rows, "machine": describe_machine("numba", "numpy", clock="CPU time of one thread")}


def measure(case: Case, *, serves: int = SERVES) -> dict[str, object]:
    """One row."""
    path = draw_serves([ServeConfig(speed_mps=case.speed_mps)] * serves, np.random.default_rng(SEED))
    end_us = int(np.ceil(path.end_s * 1e6 / BLOCK_US)) * BLOCK_US
    config, scene = SensorConfig(noise_hz=case.noise_hz), scene_named(case.scene)
    started_s = time.thread_time()
    rigs = [
        EventCamera(camera, scene, config, np.random.default_rng(SEED + index))
        for index, camera in enumerate(stereo_preset(sensor=case.sensor).values())
    ]
    ready_s = time.thread_time()
    events = 0
    for now_us in range(BLOCK_US, end_us + 1, BLOCK_US):
        for rig in rigs:
            events += len(rig.advance(path, now_us))
    spent_s = time.thread_time() - ready_s
    return {
        "scene": case.scene,
        "sensor": str(case.sensor),
        "cameras": len(rigs),
        "speed_mps": case.speed_mps,
        "noise_hz": case.noise_hz,
        "events_per_s": round(events / (end_us * 1e-6)),
        "real_time": end_us * 1e-6 / spent_s,
        "cpu_s": spent_s,
        "setup_s": ready_s - started_s,
    }
