"""Simulated event cameras: one, which is given the ball's path and asked for the events of the next block of time; and
several that see the same ball, with events in chunks.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from core.cameras import Camera
from core.errors import ConfigError
from core.events import Events
from core.simulation.bodies.parts import BodyProbes, MovingBodies
from core.simulation.bodies.view import BodyView, make_scene_view
from core.simulation.event_cameras.event_kernel import event_kernel_block, update_spans
from core.simulation.flights import BallPath
from core.simulation.scenes.background import LOG_LIGHT, make_background
from core.simulation.scenes.block_view import RACKET, RacketView, Steps, moving_steps
from core.simulation.scenes.racket_view import RacketPath
from core.simulation.scenes.scene import SceneConfig
from core.simulation.sensor.pixels import EventBuffer, PixelTiming, settle_active
from core.simulation.sensor.readout import (
    MergedEvents,
    Readout,
    ReadoutCounts,
    draw_hot_pixels,
    merge_noise,
    noise_model,
)
from core.simulation.sensor.sensor import SensorConfig, make_pixels

BLOCK_US: Final = 10_000
"""Blocks start at whole multiples of this, whatever stretches are asked for, so that chunking changes nothing."""
FIRST_CAPACITY: Final = 1 << 19


class EventCamera:
    """A camera with the state of its pixels. Time starts at `start_us` and is asked for in order, in whole blocks."""

    def __init__(
        self,
        camera: Camera,
        scene: SceneConfig,
        config: SensorConfig,
        rng: np.random.Generator,
        bodies: MovingBodies | None = None,
        start_us: int = 0,
    ) -> None:
        self.camera = camera
        self._scene = scene
        self._config = config
        self._rng = rng
        self._view = make_scene_view(
            camera, scene, make_background(camera, scene), None if bodies is None else bodies.parts
        )
        self._bodies = BodyView(camera, bodies)
        # The order of these draws is part of what a seed means.
        self._pixels = make_pixels(self._view.maps[:, LOG_LIGHT], config, rng)
        self._timing = PixelTiming(float(config.photoreceptor_us), float(config.refractory_us))
        self._hot = draw_hot_pixels(camera.sensor, config, rng)
        self._noise = noise_model(camera.sensor, config, self._hot)
        self._events = EventBuffer.empty(FIRST_CAPACITY)
        self._racket_seen: np.ndarray | None = None
        self._readout = Readout()
        self._now_us = start_us
        self._fresh = True

    @property
    def readout_counts(self) -> ReadoutCounts:
        """Events that the readout passed on, delayed and dropped so far."""
        return self._readout.counts

    @property
    def config(self) -> SensorConfig:
        """The sensor with its present noise."""
        return self._config

    @property
    def now_us(self) -> int:
        """How far this camera has got."""
        return self._now_us

    def set_noise(self, noise_hz: float) -> None:
        """Background events per pixel and second from the next block on.

        Raises:
            ConfigError: if the rate is out of bounds.
        """
        self._config = dataclasses.replace(self._config, noise_hz=noise_hz)
        self._noise = noise_model(self.camera.sensor, self._config, self._hot)

    def advance(self, path: BallPath, end_us: int, racket: RacketPath | None = None) -> Events:
        """The events from `now_us` up to, not including, `end_us`. A racket is there from the start, or never.

        Raises:
            ConfigError: if `end_us` is not a later whole multiple of `BLOCK_US`.
        """
        if end_us <= self._now_us or end_us % BLOCK_US:
            raise ConfigError("cannot simulate to this time", expected=f"a later multiple of {BLOCK_US} us", got=end_us)
        parts = [self._advance_block(path, racket) for _ in range((end_us - self._now_us) // BLOCK_US)]
        t = np.concatenate([part.t_us for part in parts])
        x, y = np.concatenate([part.x_px for part in parts]), np.concatenate([part.y_px for part in parts])
        on = np.concatenate([part.on for part in parts])
        for column in (t, x, y, on):
            column.flags.writeable = False
        return Events(t, x, y, on, self.camera.sensor)

    def _advance_block(self, path: BallPath, racket: RacketPath | None) -> MergedEvents:
        start_us, end_us = self._now_us, self._now_us + BLOCK_US
        seen = None if racket is None else RacketView(racket, self._scene.racket, self._racket_seen)
        bodies = self._bodies.probe(start_us, end_us)
        least = self._bodies.substeps(bodies)
        steps = moving_steps(self.camera, self._scene, path, seen, start_us, end_us, least)
        if racket is not None and steps is not None and steps.strides[RACKET]:
            self._racket_seen = steps.outlines[-1]
        self._events.filled[0] = 0
        if steps is not None:
            if self._fresh:
                update_spans(self._pixels, self._view, steps, bodies, self._bodies.updates, self._timing, self._events)
            self._sweep(steps, bodies)
        self._fresh = False
        while not settle_active(self._pixels, float(end_us), self._timing, self._events):
            self._events = self._events.doubled()
        refractory_us, width = self._config.refractory_us, self.camera.sensor.width_px
        merged = merge_noise(
            self._events, self._pixels.last_event_us, self._noise, start_us, end_us, refractory_us, width, self._rng
        )
        self._now_us = end_us
        return self._readout.pass_on(merged, end_us, self._config)

    def _sweep(self, steps: Steps, bodies: BodyProbes) -> None:
        done = 0
        while done < len(steps.t_us) - 1:
            done = event_kernel_block(
                self._pixels, self._view, steps, bodies, self._bodies.updates, self._timing, self._events, done
            )
            if done < len(steps.t_us) - 1:
                self._events = self._events.doubled()


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
