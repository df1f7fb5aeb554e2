"""What the clusters of a window measure: how many events, where on average, how far spread."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.fast.cluster import NO_TIMES, ClusterMemory, label_events
from core.jit import njit


class Clusters(NamedTuple):
    """N clusters of one window, in the order of their first events."""

    events: NDArray[np.int64]
    u_px: NDArray[np.float64]
    v_px: NDArray[np.float64]
    """Centroid of the events."""
    r_px: NDArray[np.float64]
    """Mean distance of the events from it."""
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
