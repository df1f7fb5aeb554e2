"""Fixtures that several parts use: the shared real data, and a short simulated recording with truth."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from core.cameras import Camera, stereo_preset
from core.cameras.presets import camera_preset
from core.events import SensorSize
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import evaluation_balls
from core.live.worlds.simulated_backend import SimulatedBackend
from core.live.worlds.world import Block
from core.outcomes.perceived_backend import PerceivedBackend
from core.recordings import RecordingWriter
from core.registry import forgotten_afterwards, use_plugins
from core.simulation import (
    LaunchConfig,
    SensorConfig,
    StereoConfig,
    ball_truth,
    draw_serve_series,
    pixel_truth,
    simulate_recording,
    simulate_stereo,
    truth_times,
)
from core.simulation.episodes.ball_outcome import BallOutcome

pytest_plugins = ["tests.sizes", "tests.stacks"]

# The same inputs in every run, and no measure of time: a busy machine is no reason to fail.
settings.register_profile(
    "suite", max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
settings.load_profile("suite")

HERE = Path(__file__).parent
SHARED = Path(os.environ.get("RALLYSCOPE_SHARED_DATA") or HERE.parents[1] / "shared" / "data")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings and flights."""
    if not SHARED.is_dir():
        pytest.skip(
            f"no public recordings and flights: {SHARED} is not a folder. docs/how/test-data.md says where each file "
            "comes from; RALLYSCOPE_SHARED_DATA names the folder with them"
        )
    return SHARED


@pytest.fixture(scope="session")
def plugins() -> Path:
    """The folder with the example plugins of the documentation."""
    return HERE.parent / "docs" / "examples" / "plugins"


@pytest.fixture(scope="module")
def data_set_readers(plugins: Path) -> Iterator[None]:
    """The example plugins that read data sets are in use."""
    with forgotten_afterwards():
        use_plugins([plugins / f"{name}_reader.py" for name in ("n_mnist", "n_imagenet", "evimo", "m3ed")])
        yield


@pytest.fixture(scope="session")
def serve_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """0.6 s of one serve at 5 m/s, two calibrated 1280x720 cameras, with truth. Do not write to it."""
    path = draw_serve_series([LaunchConfig(speed_mps=5.0)], np.random.default_rng(7))
    cameras = stereo_preset()
    file = tmp_path_factory.mktemp("recordings") / "serve.h5"
    sensors = {name: camera.sensor for name, camera in cameras.items()}
    with RecordingWriter(file, sensors, calibration=cameras, seed=7) as writer:
        for chunk in simulate_stereo(StereoConfig(), cameras, path, seed=7, duration_us=600_000):
            for name, events in chunk.events.items():
                writer.append(name, events)
        times_us = truth_times(path, 0, 600_000)
        writer.write_ball(ball_truth(path, times_us))
        for name, camera in cameras.items():
            writer.write_truth(name, pixel_truth(camera, path, times_us))
    return file


@pytest.fixture(scope="session")
def four_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """0.85 s of one serve, four calibrated 640x360 cameras at the corners, with truth. Do not write to it."""
    file = tmp_path_factory.mktemp("recordings") / "four.h5"
    half = np.diag([0.5, 0.5, 1.0])
    cameras = {
        name: Camera(SensorSize(640, 360), half @ camera.K, camera.distortion, camera.T_world_camera)
        for name, camera in camera_preset("corners").items()
    }
    config = StereoConfig(sensor=SensorConfig(noise_hz=0.1))
    simulate_recording(file, config, cameras, [LaunchConfig()], seed=4)
    return file


@pytest.fixture(scope="session")
def stroke_recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, BallOutcome]:
    """A serve of 6 m/s and a stroke: the events of two calibrated cameras and nothing else; and what came of it.

    Do not write to it.
    """
    environment = EnvironmentConfig(state_source="events", outcomes="events")
    blocks: list[Block] = []
    world_backend = SimulatedBackend(environment.task, seed=4, on_block=blocks.append)
    backend = PerceivedBackend(environment, world_backend)
    try:
        ball = backend.observe(evaluation_balls(6.0, 1, environment))
        backend.play(ball, np.array([[0.0, 0.4, 0.0]]))
        while not any(block.outcomes for block in blocks[:-20]):
            world_backend.advance()
    finally:
        backend.close()
    file = tmp_path_factory.mktemp("recordings") / "stroke.h5"
    sensors = {name: camera.sensor for name, camera in world_backend.cameras.items()}
    with RecordingWriter(file, sensors, calibration=world_backend.cameras) as writer:
        for block in blocks:
            for name, events in block.events.items():
                writer.append(name, events)
    return file, next(block.outcomes[0].outcome for block in blocks if block.outcomes)
