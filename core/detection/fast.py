"""The detector that runs live: the stages of the readable pipeline fused into one compiled call per window."""

from __future__ import annotations

from typing import Final

from core.detection.config import DetectorConfig
from core.detection.detector import Detection
from core.detection.fast_memory import Memory, allocate, limits_of
from core.detection.fast_window import find_ball
from core.detection.flicker import FlickerMemory, keep_steady_pixels
from core.detection.hot_pixels import HotPixelMemory, keep_cool_pixels
from core.detection.polarity import remember
from core.detection.roi import Roi, follow, roi_around
from core.detection.trace import TrackState
from core.events import Events, SensorSize, Window

ROOM: Final = 1 << 14
"""Events of a window that the working arrays hold at first; they grow."""


class FastDetector:
    """Answers exactly as `ReferenceDetector` does, some 20 to 50 times faster."""

    def __init__(self, config: DetectorConfig, sensor: SensorSize | None = None) -> None:
        """Without a sensor the working arrays are made at the first window."""
        self.config = config
        self.extra_circles = 0
        self._limits = limits_of(config)
        self._sensor = sensor
        self._memory: Memory | None = allocate(config, sensor, ROOM) if sensor else None
        self._track = TrackState()
        self._hot_pixels: HotPixelMemory | None = None
        self._flicker: FlickerMemory | None = None

    @property
    def state(self) -> TrackState:
        """What it remembers, as a value that later windows do not change."""
        return TrackState(
            self._track.centre_px,
            self._track.misses,
            self._track.on_leads,
            self._hot_pixels.copy() if self._hot_pixels else None,
            self._flicker.copy() if self._flicker else None,
        )

    def reset(self) -> None:
        """Forget everything seen before."""
        self._track = TrackState()
        self._hot_pixels = self._flicker = None
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball in this window, or None."""
        config, track = self.config, self._track
        events = self._drop_bad_pixels(window.events)
        roi = roi_around(track.centre_px, config.roi)
        circles = self._find(events, roi) if len(events) else 0
        self.extra_circles = max(0, circles - 1)
        window_us = window.end_us - window.start_us
        if not circles:
            centre_px, misses = follow(track.centre_px, track.misses, None, config.roi)
            memory = remember(track.on_leads, None, window_us, config.polarity)
            self._track = TrackState(centre_px, misses, memory)
            return None
        assert self._memory is not None
        u, v, r, evidence = self._memory.answer.tolist()
        centre_px, misses = follow(track.centre_px, track.misses, (u, v), config.roi)
        self._track = TrackState(centre_px, misses, remember(track.on_leads, evidence, window_us, config.polarity))
        return Detection(window.end_us, u, v, r)

    def _drop_bad_pixels(self, events: Events) -> Events:
        """The optional stages; unlike in the readable pipeline their memories are changed in place."""
        if self.config.hot_pixels.enabled:
            self._hot_pixels = self._hot_pixels or HotPixelMemory.blank(events.sensor)
            events = events.rows(keep_cool_pixels(events, self._hot_pixels, self.config.hot_pixels))
        if self.config.flicker.enabled:
            self._flicker = self._flicker or FlickerMemory.blank(events.sensor)
            events = events.rows(keep_steady_pixels(events, self._flicker, self.config.flicker))
        return events

    def _find(self, events: Events, roi: Roi | None) -> int:
        """Number of circles in the region; the chosen one is in the answer of the working arrays."""
        sensor = events.sensor
        x_min, x_max, y_min, y_max = 0, sensor.width_px - 1, 0, sensor.height_px - 1
        if roi is not None:
            x_min, x_max = max(x_min, roi.x_min), min(x_max, roi.x_max)
            y_min, y_max = max(y_min, roi.y_min), min(y_max, roi.y_max)
        memory = self._memory
        if memory is None or sensor != self._sensor or len(events) >= len(memory.events):
            memory = self._memory = allocate(self.config, sensor, max(ROOM, 2 * len(events)))
            self._sensor = sensor
        u, v = self._track.centre_px or (0.0, 0.0)
        return find_ball(
            events.t_us, events.x_px, events.y_px, events.on, roi is None, x_min, x_max, y_min, y_max, u, v,
            self._track.on_leads, self._limits, memory,
        )  # fmt: skip
