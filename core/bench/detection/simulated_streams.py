"""Simulated flights to measure detectors on: events in memory, served like a camera of a recording, with the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.presets import stereo_preset
from core.events import Events, SensorSize, concatenate_events
from core.recordings import PixelTruth, Triggers
from core.simulation.bodies import make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.event_cameras.stereo import StereoConfig, simulate_stereo
from core.simulation.flights.serve import LaunchConfig
from core.simulation.scenes.scene import scene_named
from core.simulation.sensor.sensor import SensorConfig
from core.simulation.truth import pixel_truth

TRUTH_EVERY_US = 500


@dataclass(frozen=True, slots=True, eq=False)
class MemoryStream:
    """One simulated camera in memory."""

    name: str
    events: Events
    truth: PixelTruth
    duration_us: int

    @property
    def sensor(self) -> SensorSize:
        return self.events.sensor

    @property
    def event_count(self) -> int:
        return len(self.events)

    @property
    def calibration(self) -> Camera | None:
        return None

    @property
    def triggers(self) -> Triggers:
        return Triggers(np.empty(0, np.int64), np.empty(0, np.bool_), np.empty(0, np.int16))

    def slice(self, start_us: int, end_us: int) -> Events:
        """The events with `start_us <= t < end_us`."""
        return self.events.between(start_us, end_us)

    def counts_per_ms(self) -> NDArray[np.int64]:
        """Events in each whole millisecond."""
        edges = np.arange(0, self.duration_us + 1, 1000)
        return np.diff(np.searchsorted(self.events.t_us, edges)).astype(np.int64)


def simulate_flights(
    scene: str,
    noise_hz: float,
    speeds_mps: tuple[float, ...],
    *,
    seed: int,
    duration_us: int | None = None,
    placement: str = "side",
) -> list[MemoryStream]:
    """Both 1280x720 cameras of a placement while one serve, or rally, of each speed flies by.

    Raises:
        RallyscopeError: for an unknown scene.
    """
    cameras = stereo_preset(placement)
    config = StereoConfig(scene=scene_named(scene), sensor=SensorConfig(noise_hz=noise_hz))
    serves = [LaunchConfig(speed_mps=speed) for speed in speeds_mps]
    path, strokes = draw_flights(config.scene, serves, np.random.default_rng(seed))
    bodies = make_actors(config.scene.cast, seed, strokes)
    chunks = list(simulate_stereo(config, cameras, path, seed=seed, duration_us=duration_us, bodies=bodies))
    end_us = chunks[-1].end_us
    return [
        MemoryStream(
            name,
            concatenate_events([chunk.events[name] for chunk in chunks], camera.sensor),
            pixel_truth(camera, path, np.arange(0, end_us, TRUTH_EVERY_US), bodies),
            end_us,
        )
        for name, camera in cameras.items()
    ]
