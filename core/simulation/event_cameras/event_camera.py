"""One simulated event camera: give it the ball's path and ask for the events of the next stretch of time."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from core.cameras import Camera
from core.errors import ConfigError
from core.events import Events
from core.simulation.bodies.parts import BodyProbes, MovingBodies
from core.simulation.bodies.view import BodyView
from core.simulation.event_cameras.event_kernel import RACKET, event_kernel_block, settle_block, update_spans
from core.simulation.flights.ball_path import BallPath
from core.simulation.scenes.background import LOG_LIGHT, make_background
from core.simulation.scenes.block_view import RacketView, Steps, moving_steps, view_numbers
from core.simulation.scenes.racket_shape import RacketPath
from core.simulation.scenes.scene import SceneConfig
from core.simulation.sensor.noise import MergedEvents, RawEvents, draw_hot_pixels, draw_noise, merge_events
from core.simulation.sensor.pixels import EVENT_ON, EVENT_PIXEL, EVENT_TIME_US, event_buffer
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
        self._maps = make_background(camera, scene)
        self._view = view_numbers(camera)
        self._bodies = BodyView(camera, scene, bodies)
        self._pixels = make_pixels(self._maps[:, LOG_LIGHT], config, rng)
        self._hot = draw_hot_pixels(camera.sensor, config, rng)
        self._events = event_buffer(FIRST_CAPACITY)
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
        if self._fresh and steps is not None:
            self._look_at_once(steps, bodies)
        self._fresh = False
        count = self._sweep(steps, bodies) if steps is not None else 0
        count = self._settle(end_us, count)
        signal = self._sorted(count, start_us, end_us)
        noise = draw_noise(self.camera.sensor, self._config, self._hot, start_us, end_us, self._rng)
        self._now_us = end_us
        width = self.camera.sensor.width_px
        merged = merge_events(signal, noise, self._pixels.rows, self._config.refractory_us, width)
        return self._readout.pass_on(merged, end_us, self._config)

    def _look_at_once(self, steps: Steps, bodies: BodyProbes) -> None:
        pixels, mine = self._pixels.rows, self._bodies
        update_spans(
            pixels, self._shape, self._maps, mine.layers, self._view, steps.rows, steps.rackets, steps.boxes,
            self._described(bodies), mine.looks,
        )  # fmt: skip

    @property
    def _shape(self) -> tuple[int, int]:
        return self.camera.sensor.width_px, self.camera.sensor.height_px

    def _described(self, bodies: BodyProbes) -> tuple:
        return bodies.ends, bodies.circles, self._bodies.parts, self._bodies.scene

    def _sweep(self, steps: Steps, bodies: BodyProbes) -> int:
        pixels, mine = self._pixels, self._bodies
        count, done = 0, 0
        while True:
            count, pixels.active_count, done = event_kernel_block(
                pixels.rows,
                pixels.active,
                pixels.active_list,
                pixels.active_count,
                self._shape,
                self._maps,
                mine.layers,
                self._view,
                steps.t_us,
                steps.rows,
                steps.rackets,
                steps.outlines,
                steps.boxes,
                steps.strides,
                steps.swing.log_light,
                steps.swing.stride,
                self._sensor(count),
                self._described(bodies),
                mine.looks,
                self._events,
                done,
            )
            if done == len(steps.t_us) - 1:
                return count
            self._grow(count)

    def _settle(self, end_us: int, count: int) -> int:
        pixels = self._pixels
        while True:
            count, pixels.active_count, finished = settle_block(
                pixels.rows,
                pixels.active,
                pixels.active_list,
                pixels.active_count,
                float(end_us),
                self._sensor(count),
                self._events,
            )
            if finished:
                return count
            self._grow(count)

    def _sensor(self, count: int) -> tuple[float, float, float]:
        return self._config.photoreceptor_us, float(self._config.refractory_us), float(count)

    def _grow(self, count: int) -> None:
        larger = event_buffer(2 * len(self._events))
        larger[:count] = self._events[:count]
        self._events = larger

    def _sorted(self, count: int, start_us: int, end_us: int) -> RawEvents:
        """The buffers in order of time, whole microseconds; of equal times, the pixel that was swept first is first."""
        t_us = np.clip(np.floor(self._events[:count, EVENT_TIME_US]).astype(np.int64), start_us, end_us - 1)
        order = np.argsort(t_us, kind="stable")
        found = self._events[order]
        return RawEvents(t_us[order], found[:, EVENT_PIXEL].astype(np.int64), found[:, EVENT_ON] > 0)
