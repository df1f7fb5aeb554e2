"""Several event cameras that see the same ball: events in chunks, truth at any time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from core.cameras import Camera
from core.errors import ConfigError
from core.events import Events
from core.simulation.bodies import MovingBodies
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights.ball_path import BallPath
from core.simulation.scenes.scene import SceneConfig
from core.simulation.sensor.readout import ReadoutCounts
from core.simulation.sensor.sensor import SensorConfig

CHUNK_US = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoConfig:
    """Scene and sensor, the same for all cameras."""

    scene: SceneConfig = field(default_factory=SceneConfig)
    sensor: SensorConfig = field(default_factory=SensorConfig)


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """The events of all cameras in [start_us, end_us)."""

    start_us: int
    end_us: int
    events: dict[str, Events]
    readout: dict[str, ReadoutCounts]
    """What each camera's readout did to the events since the start."""


def simulate_stereo(
    config: StereoConfig,
    cameras: Mapping[str, Camera],
    path: BallPath,
    *,
    seed: int,
    duration_us: int | None = None,
    chunk_us: int = CHUNK_US,
    bodies: MovingBodies | None = None,
    threads: int | None = None,
) -> Iterator[Chunk]:
    """The events of every camera, chunk after chunk, from time 0 to the path's end or `duration_us`.

    `bodies` are what moves besides the ball, see `make_bodies`. The cameras work in so many threads, one each unless
    told otherwise.

    The same seed, cameras and path give the same events, however they are cut into chunks. The last chunk ends at the
    first whole block after the duration. Times are int64 microseconds.

    Raises:
        ConfigError: if `chunk_us` is not a whole number of blocks (`BLOCK_US`).
    """
    if chunk_us <= 0 or chunk_us % BLOCK_US:
        raise ConfigError("chunks must be whole blocks", expected=f"a multiple of {BLOCK_US} us", got=chunk_us)
    wanted_us = duration_us if duration_us is not None else int(np.ceil(path.end_s * 1e6)) + BLOCK_US
    last_us = -(-wanted_us // BLOCK_US) * BLOCK_US
    seeds = np.random.SeedSequence(seed).spawn(len(cameras))
    rigs = {
        name: EventCamera(camera, config.scene, config.sensor, np.random.default_rng(seed_of_camera), bodies)
        for (name, camera), seed_of_camera in zip(cameras.items(), seeds, strict=True)
    }
    with ThreadPoolExecutor(
        threads or len(rigs), thread_name_prefix="event-camera"
    ) as pool:  # the kernels release the GIL
        for start_us in range(0, last_us, chunk_us):
            end_us = min(start_us + chunk_us, last_us)
            running = {name: pool.submit(rig.advance, path, end_us) for name, rig in rigs.items()}
            events = {name: future.result() for name, future in running.items()}
            yield Chunk(start_us, end_us, events, {name: rig.readout_counts for name, rig in rigs.items()})
