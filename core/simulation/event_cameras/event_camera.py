"""One simulated event camera: give it the ball's path and ask for the events of the next stretch of time."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from core.cameras import Camera
from core.errors import ConfigError
from core.events import Events
from core.simulation.bodies.parts import BodyProbes, MovingBodies
from core.simulation.bodies.view import BodyView, make_scene_view
from core.simulation.event_cameras.event_kernel import event_kernel_block, update_spans
from core.simulation.flights.ball_path import BallPath
from core.simulation.scenes.background import LOG_LIGHT, make_background
from core.simulation.scenes.block_view import RacketView, moving_steps
from core.simulation.scenes.racket_shape import RacketPath
from core.simulation.scenes.scene import SceneConfig
from core.simulation.scenes.steps import RACKET, Steps
from core.simulation.sensor.noise import MergedEvents, draw_hot_pixels, merge_noise, noise_model
from core.simulation.sensor.pixels import EventBuffer, PixelTiming, settle_active
from core.simulation.sensor.readout import Readout, ReadoutCounts
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
