"""Simulated flights to measure detectors on: the cameras of a recording, with the truth."""

from __future__ import annotations

import tempfile
from pathlib import Path

from core.cameras.presets import stereo_preset
from core.recordings import CameraStream, open_recording
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, scene_named, simulate_recording


def simulate_flights(
    scene: str, noise_hz: float, speeds_mps: tuple[float, ...], *, seed: int, placement: str = "side"
) -> list[CameraStream]:
    """Both 1280x720 cameras of a placement while one serve, or rally, of each speed flies by.

    Raises:
        RallyscopeError: for an unknown scene.
    """
    config = StereoConfig(scene=scene_named(scene), sensor=SensorConfig(noise_hz=noise_hz))
    serves = [LaunchConfig(speed_mps=speed) for speed in speeds_mps]
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as folder:
        path = Path(folder) / "flights.h5"
        simulate_recording(path, config, stereo_preset(placement), serves, seed=seed)
        return list(open_recording(path).cameras.values())
