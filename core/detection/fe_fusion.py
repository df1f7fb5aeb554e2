"""F-E Fusion as a detector: one cluster of the window's events is the ball.

The source clusters the events (DBSCAN) and takes a cluster's centroid and the mean distance of its events from it as
the ball's place and radius; which cluster is the ball, its neural field decides. That field is left out here. In its
place stand, as ours: limits for the events, the radius and the elongation of a cluster, a smallest share of events in
the last third of the window, the region of interest around the last centre, and, of several clusters within the limits,
the one with most events. An opening before the clusters is ours too, and off by default.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.fast.cluster import NO_TIMES, ClusterMemory, allocate_clusters, label_events
from core.detection.fe_fusion_config import FeFusionConfig
from core.detection.method_trace import (
    NOISE,
    RAW,
    RESULT,
    CandidateRow,
    MethodTrace,
    Outline,
    PixelLayer,
    StageCount,
    View,
    circle_points,
    region_shapes,
)
from core.detection.reasons import Limit, Reason, failed_limits
from core.detection.stages.denoise import DenoiseConfig, survives_opening
from core.detection.stages.roi import Centre, Roi, RoiConfig, inside_roi, next_region, roi_around
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
    fresh: NDArray[np.float64]
    """Share of the events that are new, see `new_events`."""


@njit
def measure_clusters(x_px, y_px, new, memory: ClusterMemory) -> Clusters:
    """The DBSCAN clusters of one event or more; noise is left out."""
    count, labels = len(x_px), memory.labels
    clusters = label_events(x_px, y_px, NO_TIMES, memory)
    events, sum_x, sum_y = np.zeros(clusters, np.int64), np.zeros(clusters), np.zeros(clusters)
    fresh = np.zeros(clusters)
    low, high = np.full((2, clusters), np.inf), np.full((2, clusters), -np.inf)
    for i in range(count):
        label = labels[i]
        if label >= 0:
            x, y = float(x_px[i]), float(y_px[i])
            events[label] += 1
            sum_x[label] += x
            sum_y[label] += y
            fresh[label] += new[i]
            low[0, label], high[0, label] = min(low[0, label], x), max(high[0, label], x)
            low[1, label], high[1, label] = min(low[1, label], y), max(high[1, label], y)
    u, v, distance = sum_x / events, sum_y / events, np.zeros(clusters)
    for i in range(count):
        label = labels[i]
        if label >= 0:
            distance[label] += math.hypot(x_px[i] - u[label], y_px[i] - v[label])
    sides = high - low + 1.0
    elongation = np.maximum(sides[0] / sides[1], sides[1] / sides[0])
    return Clusters(events, u, v, distance / events, elongation, fresh / events)


def new_events(events: Events, window: Window) -> NDArray[np.bool_]:
    """(N,) whether each event is of the last third of the window."""
    return 3 * (window.end_us - events.t_us) <= window.end_us - window.start_us


def possible_balls(clusters: Clusters, config: FeFusionConfig) -> NDArray[np.intp]:
    """The numbers of the clusters with the events, the spread and the shape of a ball: the one with most events first.

    That one is the answer. Taking the one nearest to the last centre instead was no better on development flights.
    """
    possible = np.ones(len(clusters.events), np.bool_)
    for values, limit in zip(_measured(clusters), ball_limits(config), strict=True):
        possible &= (limit.low <= values) & (values <= limit.high)
    chosen = np.flatnonzero(possible)
    return chosen[np.argsort(-clusters.events[chosen], kind="stable")]


def ball_limits(config: FeFusionConfig) -> tuple[Limit, ...]:
    """The limits of a ball's cluster."""
    inf = math.inf
    return (
        Limit("events of the cluster", "fe_fusion.size_min", config.size_min, inf),
        Limit("radius", "fe_fusion.radius_min_px", config.radius_min_px, inf, "px"),
        Limit("radius", "fe_fusion.radius_max_px", -inf, config.radius_max_px, "px"),
        Limit("elongation", "fe_fusion.elongation_max", -inf, config.elongation_max),
        Limit("events in the last third", "fe_fusion.fresh_min", config.fresh_min, inf),
    )


def _measured(clusters: Clusters) -> tuple[NDArray[np.number], ...]:
    """What is compared with `ball_limits`, in its order."""
    return clusters.events, clusters.r_px, clusters.r_px, clusters.elongation, clusters.fresh


VIEWS: Final = (RAW, "denoised", "clusters", RESULT)
"""The stages, as on their buttons."""


@dataclass(frozen=True, slots=True, eq=False)
class FeFusionTrace:
    """All stages of one window."""

    roi: Roi | None
    """Where the ball is searched; None: everywhere."""
    kept: Events
    """Events of the region that survive denoising."""
    labels: NDArray[np.int64]
    """(N,) number of each one's cluster, -1 for none."""
    clusters: Clusters | None
    """None if there are no events."""
    detection: Detection | None
    seconds: float


ROOM: Final = 1 << 14
"""Initial capacity of the working arrays, in events; they grow."""


class FeFusionDetector:
    """Answers with the centroid of one cluster, and the mean distance of its events as the radius.

    Of the clusters in the region of interest with the events, the spread and the shape of a ball, the one with most
    events is the ball; the region, the limits and this choice are not the source's, see the module. An estimate is
    valid at the middle of its window less `delay_us`: its events are spread evenly over the window, and their mean is
    where the ball was on average.
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
        self._clusters: Clusters | None = None
        self._counts = 0, 0
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball in the middle of this window less the sensor's delay, or None. The window may be empty."""
        if window.events.sensor != self.sensor:
            self.sensor = window.events.sensor
            self._make_room(ROOM)
            self.reset()
        self.extra_circles = 0
        detection, found_px, self._clusters = None, None, None
        events = self._kept(window.events)
        self._counts = len(window.events), len(events)
        if len(events):
            # Twice what is needed: a rate that rises slowly does not allocate in every window.
            if len(events) > self._room:
                self._make_room(2 * len(events))
            clusters = self._clusters = measure_clusters(
                events.x_px, events.y_px, new_events(events, window), self._memory
            )
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

    def why_not(self) -> tuple[Reason, ...]:
        """Why the last window had no ball: limits that the cluster failed which failed the fewest, of several the
        largest.
        """
        seen, kept = self._counts
        if not kept:
            near = "fe_fusion.roi_expand_px" if seen else "window.window_us"
            return (Reason("events in the region" if seen else "events in the window", near, 0, 1),)
        failed = [] if self._clusters is None else _failed(self._clusters, self.config)
        if not failed:
            return (Reason("clusters", "fe_fusion.eps_px", 0, 1),)
        sizes = self._clusters.events if self._clusters is not None else ()
        return min(zip(failed, sizes, strict=True), key=lambda pair: (len(pair[0]), -pair[1]))[0]

    def trace(self, window: Window) -> FeFusionTrace:
        """The step of this window with every intermediate result."""
        roi = roi_around(self._centre_px, self._region)
        kept = self._kept(window.events)
        start_s = time.perf_counter()
        detection = self.step(window)
        seconds = time.perf_counter() - start_s
        labels = self._memory.labels[: len(kept)].astype(np.int64)  # copied: the next window overwrites them
        return FeFusionTrace(roi, kept, labels, self._clusters, detection, seconds)

    def explain(self, window: Window) -> MethodTrace:
        """The step of this window as Tune and `detect --explain` show it."""
        return _view_of(self.trace(window), window, self.config, self.why_not())


def _failed(clusters: Clusters, config: FeFusionConfig) -> list[tuple[Reason, ...]]:
    """For each cluster the limits that it failed."""
    limits = ball_limits(config)
    return [failed_limits([float(value) for value in row], limits) for row in zip(*_measured(clusters), strict=True)]


def _view_of(trace: FeFusionTrace, window: Window, config: FeFusionConfig, reasons: tuple[Reason, ...]) -> MethodTrace:
    rows = () if trace.clusters is None else tuple(_rows(trace, trace.clusters, config))
    regions = region_shapes(trace.roi)
    circles = () if trace.clusters is None else tuple(
        Outline(
            "rejected" if row.reasons else "accepted", circle_points(float(u), float(v)), float(r),
            f"{row.label}: {row.reasons[0].text}" if row.reasons else f"{row.label}: {row.verdict}",
            (float(u + r) + 2, float(v - r)),
        )
        for row, u, v, r in zip(rows, trace.clusters.u_px, trace.clusters.v_px, trace.clusters.r_px, strict=True)
    )  # fmt: skip
    coloured = PixelLayer.of_events(trace.kept, np.where(trace.labels >= 0, trace.labels, NOISE))
    kept, good = len(trace.kept), sum(not row.reasons for row in rows)
    return MethodTrace(
        views=(
            View(RAW, "window", None, shows_ball=False),
            View("denoised", "fe_fusion", PixelLayer.of_events(trace.kept), regions, shows_ball=False),
            View("clusters", "fe_fusion", coloured, (*regions, *circles), shows_ball=False),
            View(RESULT, "fe_fusion", None, regions),
        ),
        counts={
            "window": StageCount(len(window.events), kept),
            "fe_fusion": StageCount(len(rows), good, "within the limits", "clusters", trace.seconds),
        },
        noun="cluster",
        titles=("events", "radius [px]", "elongation", "in the last third"),
        candidates=rows,
        detection=trace.detection,
        reasons=() if trace.detection is not None else reasons,
        where="searched in the ROI" if trace.roi else "searched on the whole sensor",
    )


def _rows(trace: FeFusionTrace, clusters: Clusters, config: FeFusionConfig) -> list[CandidateRow]:
    failed = _failed(clusters, config)
    best = next(iter(possible_balls(clusters, config)), None)
    return [
        CandidateRow(
            label=number,
            figures=(
                f"{clusters.events[number]}",
                f"{clusters.r_px[number]:.1f}",
                f"{clusters.elongation[number]:.2f}",
                f"{clusters.fresh[number]:.2f}",
            ),
            reasons=why,
            verdict="ball" if number == best else "smaller than the ball's",
            order=float(clusters.events[number]),
            x_px=trace.kept.x_px[trace.labels == number],
            y_px=trace.kept.y_px[trace.labels == number],
        )
        for number, why in enumerate(failed)
    ]
