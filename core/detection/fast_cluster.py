"""DBSCAN on pixels: the labels of scikit-learn, found on the pixel grid instead of in a tree.

scikit-learn numbers clusters by their first core point and floods each one completely before the next, so a border
point belongs to the lowest number that reaches it. Events on one pixel share all their neighbours, hence their label:
flooding pixels in the order of their first events, counting each with its number of events, gives the same array.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.detection.cluster import ClusterConfig, scaled_time
from core.events import Events, SensorSize


def neighbour_rows(eps_px: float) -> NDArray[np.int64]:
    """(2, K) the rows of the disc of radius eps, the nearest first: distance of the row, half its width."""
    reach = math.floor(eps_px)
    rows = sorted(range(-reach, reach + 1), key=abs)
    widths = [max(w for w in range(reach + 1) if w * w + dy * dy <= eps_px * eps_px) for dy in rows]
    return np.array([rows, widths], np.int64)


def grid_labels(events: Events, config: ClusterConfig) -> NDArray[np.int32]:
    """(N,) the labels of `cluster.cluster_labels`, fast."""
    count = len(events)
    rows = neighbour_rows(config.eps_px)
    frame = grid_frame(0, events.sensor.width_px - 1, 0, rows)
    grid = np.zeros(grid_size(events.sensor, rows), np.int32)
    pixel_of, cells, sizes, labels, stack, following = np.empty((6, max(1, count)), np.int32)
    pixels = _collect(events.x_px, events.y_px, grid, frame, pixel_of, cells, sizes)
    if config.time_scale_px_per_ms > 0 and count:
        times = scaled_time(events.t_us, config.time_scale_px_per_ms)
        chains = pixel_of, cells, pixels, sizes, following
        label_in_time(times, grid, frame[0], *chains, rows, config.eps_px, config.min_samples, labels, stack)
        return labels[:count]
    label_pixels(grid, frame[0], cells, sizes, pixels, rows, config.min_samples, labels, stack)
    return labels[pixel_of[:count]]


def grid_size(sensor: SensorSize, rows: NDArray[np.int64]) -> int:
    """Cells of a grid for a whole sensor with an empty margin as wide as the disc reaches."""
    margin = rows.shape[1] - 1
    return (sensor.width_px + margin) * (sensor.height_px + margin)


@njit(cache=True, nogil=True)
def grid_frame(x_min, x_max, y_min, rows):
    """Cells from a row to the next, and index of the cell of pixel (0, 0), of a grid that begins at (x_min, y_min).

    The margin makes bounds checks of neighbours superfluous. A grid as small as the events allow stays in the cache.
    """
    margin = rows.shape[1] // 2
    stride = x_max - x_min + 1 + 2 * margin
    return stride, (margin - y_min) * stride + margin - x_min


@njit(cache=True, nogil=True)
def add_event(grid, cell, cells, sizes, pixels):
    """Count an event at a cell. Returns the number of its pixel and how many pixels there are now."""
    known = grid[cell]
    if known:
        sizes[known - 1] += 1
        return known - 1, pixels
    grid[cell] = pixels + 1
    cells[pixels] = cell
    sizes[pixels] = 1
    return pixels, pixels + 1


@njit(cache=True, nogil=True)
def _collect(x_px, y_px, grid, frame, pixel_of, cells, sizes):
    pixels = 0
    stride, origin = frame
    for i in range(len(x_px)):
        pixel_of[i], pixels = add_event(grid, origin + y_px[i] * stride + x_px[i], cells, sizes, pixels)
    return pixels


@njit(cache=True, nogil=True)
def label_pixels(grid, stride, cells, sizes, pixels, rows, min_samples, labels, stack):
    """DBSCAN over pixels in the order of their first events; fills labels[:pixels], returns the number of clusters."""
    clusters = 0
    labels[:pixels] = -1
    for seed in range(pixels):
        if labels[seed] != -1 or not _is_core(grid, stride, cells[seed], sizes, rows, min_samples):
            continue
        labels[seed] = clusters
        stack[0] = seed
        depth = 1
        while depth:  # only core pixels are on the stack
            depth -= 1
            middle = cells[stack[depth]]
            for k in range(rows.shape[1]):
                line, width = middle + rows[0, k] * stride, rows[1, k]
                for cell in range(line - width, line + width + 1):
                    other = grid[cell] - 1
                    if other >= 0 and labels[other] == -1:
                        labels[other] = clusters
                        if _is_core(grid, stride, cell, sizes, rows, min_samples):
                            stack[depth] = other
                            depth += 1
        clusters += 1
    return clusters


@njit(cache=True, nogil=True)
def _is_core(grid, stride, middle, sizes, rows, min_samples):
    near = 0
    for k in range(rows.shape[1]):
        line, width = middle + rows[0, k] * stride, rows[1, k]
        for cell in range(line - width, line + width + 1):
            if grid[cell]:
                near += sizes[grid[cell] - 1]
        if near >= min_samples:
            return True
    return False


@njit(cache=True, nogil=True)
def label_in_time(
    times, grid, stride, pixel_of, cells, pixels, heads, following, rows, eps, min_samples, labels, stack
):
    """DBSCAN over events with time as a third axis; fills labels[:N], returns the number of clusters.

    `heads` and `following` are overwritten with the chain of events of each pixel.
    """
    count = len(times)
    heads[:pixels] = -1
    for i in range(count):
        following[i] = heads[pixel_of[i]]
        heads[pixel_of[i]] = i
    labels[:count] = -1
    near = np.empty(count, np.int32)
    clusters = 0
    for seed in range(count):
        if labels[seed] != -1:
            continue
        found = _near_in_time(times, seed, grid, stride, pixel_of, cells, heads, following, rows, eps, near)
        if found < min_samples:
            continue
        labels[seed] = clusters
        stack[0] = seed
        depth = 1
        while depth:
            depth -= 1
            found = _near_in_time(times, stack[depth], grid, stride, pixel_of, cells, heads, following, rows, eps, near)
            if found < min_samples:
                continue
            for k in range(found):
                if labels[near[k]] == -1:
                    labels[near[k]] = clusters
                    stack[depth] = near[k]
                    depth += 1
        clusters += 1
    return clusters


@njit(cache=True, nogil=True)
def _near_in_time(times, event, grid, stride, pixel_of, cells, heads, following, rows, eps, near):
    found = 0
    middle = cells[pixel_of[event]]
    for k in range(rows.shape[1]):
        dy, width = rows[0, k], rows[1, k]
        for dx in range(-width, width + 1):
            pixel = grid[middle + dy * stride + dx] - 1
            if pixel < 0:
                continue
            other = heads[pixel]
            while other >= 0:
                dt = times[event] - times[other]
                if dx * dx + dy * dy + dt * dt <= eps * eps:
                    near[found] = other
                    found += 1
                other = following[other]
    return found
