"""What the clusters of a window measure: how many events, where on average, how far spread."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.fast.cluster import PixelGrid, add_event, grid_frame, grid_size, label_pixels, neighbour_rows
from core.events import SensorSize
from core.jit import njit


class ClusterMemory(NamedTuple):
    """Working arrays, made once. `grid` and `free` are empty between windows."""

    grid: NDArray[np.int32]
    free: NDArray[np.uint64]
    disc: NDArray[np.int64]
    """See `neighbour_rows`."""
    per_event: NDArray[np.int32]
    """(5, room + 1): the pixel of each event; cells, sizes and labels of the pixels; a stack."""


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


def allocate_clusters(eps_px: float, sensor: SensorSize, room: int) -> ClusterMemory:
    """Room for windows of up to `room` events."""
    disc = neighbour_rows(eps_px)
    cells = grid_size(sensor, disc)
    return ClusterMemory(
        np.zeros(cells, np.int32), np.zeros(cells // 64 + 2, np.uint64), disc, np.empty((5, room + 1), np.int32)
    )


@njit
def measure_clusters(x_px, y_px, memory: ClusterMemory, min_samples: int) -> Clusters:
    """The DBSCAN clusters of one event or more; noise is left out."""
    count = len(x_px)
    grid, lists = memory.grid, memory.per_event
    pixel_of, cells, sizes, labels, stack = lists[0], lists[1], lists[2], lists[3], lists[4]
    stride, origin = grid_frame(np.int64(x_px.min()), np.int64(x_px.max()), np.int64(y_px.min()), memory.disc)
    pixels = 0
    sizes[0] = 0
    for i in range(count):
        cell = origin + np.int64(y_px[i]) * stride + np.int64(x_px[i])
        pixel_of[i], pixels = add_event(grid, cell, cells, sizes, pixels)
    known = PixelGrid(grid, stride, memory.disc, cells, sizes, labels, stack)
    clusters = label_pixels(known, pixels, memory.free, min_samples)
    for pixel in range(pixels):
        grid[cells[pixel]] = 0

    events, sum_x, sum_y = np.zeros(clusters, np.int64), np.zeros(clusters), np.zeros(clusters)
    low, high = np.full((2, clusters), np.inf), np.full((2, clusters), -np.inf)
    for i in range(count):
        label = labels[pixel_of[i]]
        if label >= 0:
            x, y = float(x_px[i]), float(y_px[i])
            events[label] += 1
            sum_x[label] += x
            sum_y[label] += y
            low[0, label], high[0, label] = min(low[0, label], x), max(high[0, label], x)
            low[1, label], high[1, label] = min(low[1, label], y), max(high[1, label], y)
    u, v, distance = sum_x / events, sum_y / events, np.zeros(clusters)
    for i in range(count):
        label = labels[pixel_of[i]]
        if label >= 0:
            distance[label] += math.hypot(x_px[i] - u[label], y_px[i] - v[label])
    sides = high - low + 1.0
    elongation = np.maximum(sides[0] / sides[1], sides[1] / sides[0])
    return Clusters(events, u, v, distance / events, elongation)
