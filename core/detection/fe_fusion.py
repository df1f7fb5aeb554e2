"""F-E Fusion as a detector: one cluster of the window's events is the ball."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.fast.cluster import NO_TIMES, ClusterMemory, allocate_clusters, label_events
from core.detection.fe_fusion_config import FeFusionConfig
from core.detection.stages.denoise import DenoiseConfig, survives_opening
from core.detection.stages.roi import Centre, RoiConfig, inside_roi, next_region, roi_around
from core.events import Events, SensorSize, Window
from core.jit import njit


class Clusters(NamedTuple):
    """N clusters of one window, in the order of their first events."""

    events: NDArray[np.int64]
    u_px: NDArray[np.float64]
    v_px: NDArray[np.float64]
    """Centroid of the events."""
    r_px: NDArray[np.float64]
    """Mean distance of the events from the centroid."""
    elongation: NDArray[np.float64]
    """Longer side of the upright bounding box over the shorter one."""


@njit
def measure_clusters(x_px, y_px, memory: ClusterMemory) -> Clusters:
    """The DBSCAN clusters of one event or more; noise is left out."""
    count, labels = len(x_px), memory.labels
    clusters = label_events(x_px, y_px, NO_TIMES, memory)
    events, sum_x, sum_y = np.zeros(clusters, np.int64), np.zeros(clusters), np.zeros(clusters)
    low, high = np.full((2, clusters), np.inf), np.full((2, clusters), -np.inf)
    for i in range(count):
        label = labels[i]
        if label >= 0:
            x, y = float(x_px[i]), float(y_px[i])
            events[label] += 1
            sum_x[label] += x
            sum_y[label] += y
            low[0, label], high[0, label] = min(low[0, label], x), max(high[0, label], x)
            low[1, label], high[1, label] = min(low[1, label], y), max(high[1, label], y)
    u, v, distance = sum_x / events, sum_y / events, np.zeros(clusters)
    for i in range(count):
        label = labels[i]
        if label >= 0:
            distance[label] += math.hypot(x_px[i] - u[label], y_px[i] - v[label])
    sides = high - low + 1.0
    elongation = np.maximum(sides[0] / sides[1], sides[1] / sides[0])
    return Clusters(events, u, v, distance / events, elongation)


def possible_balls(clusters: Clusters, config: FeFusionConfig) -> NDArray[np.intp]:
    """The numbers of the clusters with the events, the spread and the shape of a ball: the one with most events first.

    That one is the answer. Taking the one nearest to the last centre instead was no better on development flights.
    """
    radius = clusters.r_px
    possible = np.flatnonzero(
        (clusters.events >= config.size_min)
        & (config.radius_min_px <= radius)
        & (radius <= config.radius_max_px)
        & (clusters.elongation <= config.elongation_max)
    )
    return possible[np.argsort(-clusters.events[possible], kind="stable")]


ROOM: Final = 1 << 14
"""Initial capacity of the working arrays, in events; they grow."""


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
