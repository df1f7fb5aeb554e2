"""The detector `paper` and `auto` for whole recordings: the stages of the readable pipeline, compiled."""

from __future__ import annotations

import dataclasses
import math
from typing import Final

import cv2
import numpy as np

from core.detection.config import DetectorConfig
from core.detection.detector import Detection
from core.detection.fast.cluster import allocate_clusters, grid_labels
from core.detection.fast.kernels import PAD, Memory, Settings, find_ball
from core.detection.method_trace import MethodTrace
from core.detection.pipeline import trace_window
from core.detection.reasons import Reason
from core.detection.stage_trace import TrackState
from core.detection.staged_view import reasons_without_ball, view_of
from core.detection.stages.flicker import FlickerMemory, keep_steady_pixels
from core.detection.stages.hot_pixels import HotPixelMemory, keep_cool_pixels
from core.detection.stages.polarity import remember
from core.detection.stages.roi import Centre, next_region
from core.events import Events, SensorSize, Window

ROOM: Final = 1 << 14
"""Initial capacity of the working arrays, in events; they grow."""
WHOLE_SENSOR: Final = (math.nan, math.nan)
"""The centre when the whole sensor is searched."""
LEADING: Final = {"on": 1, "off": -1, "auto": 0}


class FastDetector:
    """Answers exactly as `ReferenceDetector` does, at least 20 times faster."""

    def __init__(self, config: DetectorConfig, sensor: SensorSize | None = None) -> None:
        """Without a sensor the working arrays are made at the first window."""
        self.config = config
        self.extra_circles = 0
        self._settings = _settings_of(config)
        self._sensor = sensor
        self._room = ROOM
        self._memory = _allocate(config, sensor, ROOM) if sensor else None
        self._centre_px: Centre | None = None
        self._misses = 0
        self._on_leads = 0.0
        self._hot_pixels: HotPixelMemory | None = None
        self._flicker: FlickerMemory | None = None
        self._missed: tuple[Window, TrackState] | None = None

    @property
    def state(self) -> TrackState:
        """Copy of its state, which later windows do not change."""
        return TrackState(
            self._centre_px,
            self._misses,
            self._on_leads,
            self._hot_pixels.copy() if self._hot_pixels else None,
            self._flicker.copy() if self._flicker else None,
        )

    def reset(self) -> None:
        """Forget everything seen before."""
        self.resume(TrackState())
        self.extra_circles = 0
        self._missed = None

    def resume(self, state: TrackState) -> None:
        """Continue from a state of its own or of the readable pipeline."""
        self._centre_px, self._misses, self._on_leads = state.centre_px, state.misses, state.on_leads
        self._hot_pixels = state.hot_pixels.copy() if state.hot_pixels else None
        self._flicker = state.flicker.copy() if state.flicker else None

    def step(self, window: Window) -> Detection | None:
        """The ball in this window, or None."""
        config, length_us = self.config, window.end_us - window.start_us
        events = self._drop_bad_pixels(window.events)
        circles, evidence, detection = 0, None, None
        before = TrackState(self._centre_px, self._misses, self._on_leads)
        if len(events):
            centre_px = (self._centre_px if config.roi.enabled else None) or WHOLE_SENSOR
            columns = events.t_us, events.x_px, events.y_px, events.on
            circles, u, v, r, evidence = find_ball(
                columns, centre_px, self._on_leads, self._settings, self._memory_for(events)
            )
            detection = Detection(window.end_us - config.localise.delay_us, u, v, r) if circles else None
        found_px = (detection.u_px, detection.v_px) if detection else None
        self._missed = None if detection else (Window(events, window.start_us, window.end_us), before)
        self.extra_circles = max(0, circles - 1)
        self._centre_px, self._misses = next_region(self._centre_px, self._misses, found_px, config.roi)
        self._on_leads = remember(self._on_leads, evidence if detection else None, length_us, config.polarity)
        return detection

    def why_not(self) -> tuple[Reason, ...]:
        """Limits that the nearest cluster of the last window failed, from the readable pipeline; empty after a ball."""
        if self._missed is None:
            return ()
        window, state = self._missed
        config = dataclasses.replace(  # these stages have had their turn
            self.config,
            hot_pixels=dataclasses.replace(self.config.hot_pixels, enabled=False),
            flicker=dataclasses.replace(self.config.flicker, enabled=False),
        )
        trace = trace_window(window, state, config, label_clusters=grid_labels)
        return reasons_without_ball(trace, len(window.events), config)

    def explain(self, window: Window) -> MethodTrace:
        """The step of this window with the trace of the readable pipeline, whose answer is the same."""
        trace = trace_window(window, self.state, self.config, label_clusters=grid_labels)
        detection = self.step(window)
        return dataclasses.replace(view_of(trace, window, self.config), detection=detection)

    def _memory_for(self, events: Events) -> Memory:
        """Working arrays for this sensor and so many events, kept if they are large enough."""
        if self._memory is None or len(events) > self._room or events.sensor != self._sensor:
            self._room = max(self._room, 2 * len(events))
            self._memory, self._sensor = _allocate(self.config, events.sensor, self._room), events.sensor
        return self._memory

    def _drop_bad_pixels(self, events: Events) -> Events:
        """The optional stages; unlike in the readable pipeline their memories are changed in place."""
        if self.config.hot_pixels.enabled:
            self._hot_pixels = self._hot_pixels or HotPixelMemory.blank(events.sensor)
            events = events.rows(keep_cool_pixels(events, self._hot_pixels, self.config.hot_pixels))
        if self.config.flicker.enabled:
            self._flicker = self._flicker or FlickerMemory.blank(events.sensor)
            events = events.rows(keep_steady_pixels(events, self._flicker, self.config.flicker))
        return events


def _settings_of(config: DetectorConfig) -> Settings:
    return Settings(
        time_scale_px_per_ms=float(config.cluster.time_scale_px_per_ms),
        size_min=int(config.cluster.size_min),
        size_max=int(config.cluster.size_max),
        leading=LEADING[config.polarity.leading_polarity],
        pair_radius_px=float(config.polarity.pair_radius_px),
        outlier_radius_px=float(config.polarity.outlier_radius_px),
        circularity_min=float(config.geometry.circularity_min),
        solidity_min=float(config.geometry.solidity_min),
        radius_min_px=float(config.localise.radius_min_px),
        radius_max_px=float(config.localise.radius_max_px),
        roi_expand_px=float(config.roi.roi_expand_px),
    )


def _allocate(config: DetectorConfig, sensor: SensorSize, room: int) -> Memory:
    """Working arrays for windows of up to `room` events."""
    kernel_px, (width, height) = config.denoise.kernel_px, (sensor.width_px, sensor.height_px)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (kernel_px, kernel_px))
    return Memory(
        picture=np.zeros((height + 2 * PAD, width + 2 * PAD), np.uint8),
        kernel=np.argwhere(kernel) - kernel_px // 2,
        clusters=allocate_clusters(config.cluster.eps_px, config.cluster.min_samples, sensor, room),
        rows=np.zeros((2, room), np.int64),
        x_px=np.zeros(room, np.int64),
        y_px=np.zeros(room, np.int64),
        t_us=np.zeros(room, np.int64),
        on=np.zeros(room, np.bool_),
        order=np.zeros(room, np.int64),
        starts=np.zeros(room + 1, np.int64),
        stamps=np.zeros((height, width), np.int64),
        stamp=np.zeros(1, np.int64),
        first=np.zeros(height, np.int64),
        last=np.zeros(height, np.int64),
        hull=np.zeros((2 * height + 2, 2), np.int64),
    )
