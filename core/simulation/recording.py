"""Simulated recordings: serves seen by event cameras, with the truth, written as a recording file."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from core.cameras import Camera, stereo_preset
from core.config import config_to_mapping
from core.recordings import RecordingWriter
from core.simulation.bodies import make_bodies
from core.simulation.physics.config import PhysicsConfig
from core.simulation.rally_flight import draw_flights
from core.simulation.readout import ReadoutCounts
from core.simulation.scene import SceneConfig
from core.simulation.serve import ServeConfig
from core.simulation.stereo import StereoConfig, simulate_stereo
from core.simulation.truth import ball_truth, pixel_truth, truth_times

DEMO_SERVES_MPS: Final = (5.0, 4.0, 6.0, 5.0)
"""Launch speeds of the demo's serves."""
DEMO_SEED: Final = 20


@dataclass(frozen=True, slots=True)
class SimulatedRecording:
    """What was made."""

    path: Path
    duration_us: int
    serves: int
    events: dict[str, int]
    """Per camera."""
    truths: int
    """Times at which the ball is visible, over all cameras."""
    delayed: dict[str, int]
    """Per camera: events that waited for the readout for a microsecond or more."""
    dropped: dict[str, int]
    """Per camera: events that the readout lost; a note in the recording says so."""
    finished: bool
    """False where it was cancelled: everything up to then is in the file."""


def simulate_recording(
    path: Path,
    config: StereoConfig,
    cameras: Mapping[str, Camera],
    serves: list[ServeConfig],
    *,
    seed: int,
    physics: PhysicsConfig | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> SimulatedRecording:
    """Write the events and the truth of some serves, one after the other. The same seed gives the same events.

    The physics is that of the paper unless told otherwise.

    Raises:
        RecordingError: if the file exists and `overwrite` is not set, or it cannot be written.
        ConfigError: if there is no such serve.
    """
    physics = physics or PhysicsConfig()
    flights, strokes = draw_flights(config.scene, serves, np.random.default_rng(seed), physics)
    bodies = make_bodies(config.scene.cast, seed, strokes)
    resolved = {
        **config_to_mapping(config),
        "serves": [config_to_mapping(serve) for serve in serves],
        "physics": config_to_mapping(physics),
    }
    sensors = {name: camera.sensor for name, camera in cameras.items()}
    end_us, finished = 0, True
    readout: dict[str, ReadoutCounts] = {}
    wanted_us = flights.end_s * 1e6
    with RecordingWriter(path, sensors, calibration=cameras, seed=seed, config=resolved, overwrite=overwrite) as writer:
        for chunk in simulate_stereo(config, cameras, flights, seed=seed, bodies=bodies):
            if cancelled():
                finished = False
                break
            for name, events in chunk.events.items():
                writer.append(name, events)
            end_us, readout = chunk.end_us, chunk.readout
            progress(min(1.0, end_us / wanted_us))
        times_us = truth_times(flights, 0, end_us)
        writer.write_ball(ball_truth(flights, times_us))
        truths = 0
        for name, camera in cameras.items():
            truth = pixel_truth(camera, flights, times_us, bodies)
            truths += int(truth.visible.sum())
            writer.write_truth(name, truth)
        writer.extend_duration(end_us)
        for name, counted in readout.items():
            if counted.dropped:
                writer.note(f"the readout of {name} dropped {counted.dropped:,} events")
        counts = {name: writer.event_count(name) for name in cameras}
    delayed = {name: counted.delayed for name, counted in readout.items()}
    dropped = {name: counted.dropped for name, counted in readout.items()}
    return SimulatedRecording(path, end_us, len(serves), counts, truths, delayed, dropped, finished)


def ensure_demo(path: Path, progress: Callable[[float], None] = lambda share: None) -> None:
    """Make the demo recording if it is not there yet: four serves, two calibrated 1280x720 cameras at the side.

    It appears under its name only once it is whole.
    """
    if path.exists():
        return
    partial = path.with_name(f".{path.stem}.{os.getpid()}.h5")
    serves = [ServeConfig(speed_mps=speed, yaw_spread_deg=2.0) for speed in DEMO_SERVES_MPS]
    config = StereoConfig(scene=SceneConfig())
    try:
        simulate_recording(partial, config, stereo_preset(), serves, seed=DEMO_SEED, overwrite=True, progress=progress)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
