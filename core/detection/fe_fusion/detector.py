"""F-E Fusion as a detector: one cluster of the window's events is the ball."""

from __future__ import annotations

from typing import Final

from core.detection.detector import Detection
from core.detection.fast.cluster import allocate_clusters
from core.detection.fe_fusion.choice import possible_balls
from core.detection.fe_fusion.clusters import measure_clusters
from core.detection.fe_fusion_config import FeFusionConfig
from core.detection.stages.denoise import DenoiseConfig, survives_opening
from core.detection.stages.roi import Centre, RoiConfig, inside_roi, next_region, roi_around
from core.events import Events, SensorSize, Window

ROOM: Final = 1 << 14
"""Events of a window that the working arrays hold at first; they grow."""


class FeFusionDetector:
    """Answers with the centroid of one cluster, and the mean distance of its events as the radius.

    Of the clusters in the region of interest with the events, the spread and the shape of a ball, the one with most
    events is the ball. An estimate is valid at the middle of its window less `delay_us`: its events are spread evenly
    over the window, and their mean is where the ball was on average.
    """

    def __init__(self, config: FeFusionConfig, sensor: SensorSize) -> None:
        self.config = config
        self.sensor = sensor
        self._region = RoiConfig(roi_expand_px=config.roi_expand_px, misses_to_reset=config.misses_to_reset)
        self._make_room(ROOM)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen before."""
        self._centre_px: Centre | None = None
        self._misses = 0
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball in the middle of this window less the sensor's delay, or None. The window may be empty."""
        if window.events.sensor != self.sensor:
            self.sensor = window.events.sensor
            self._make_room(ROOM)
            self.reset()
        self.extra_circles = 0
        detection, found_px = None, None
        events = self._kept(window.events)
        if len(events):
            if len(events) > self._room:
                self._make_room(2 * len(events))
            clusters = measure_clusters(events.x_px, events.y_px, self._memory)
            possible = possible_balls(clusters, self.config)
            if len(possible):
                ball = possible[0]
                u, v, r = (float(column[ball]) for column in (clusters.u_px, clusters.v_px, clusters.r_px))
                found_px = u, v
                middle_us = (window.start_us + window.end_us) // 2
                detection = Detection(middle_us - self.config.delay_us, u, v, r)
                self.extra_circles = len(possible) - 1
        self._centre_px, self._misses = next_region(self._centre_px, self._misses, found_px, self._region)
        return detection

    def _kept(self, events: Events) -> Events:
        """The events of the region that survive denoising."""
        roi = roi_around(self._centre_px, self._region)
        if roi is not None:
            events = events.rows(inside_roi(events, roi))
        if self.config.kernel_px > 1:
            events = events.rows(survives_opening(events, DenoiseConfig(kernel_px=self.config.kernel_px)))
        return events

    def _make_room(self, room: int) -> None:
        self._room = room
        self._memory = allocate_clusters(self.config.eps_px, self.config.min_samples, self.sensor, room)
