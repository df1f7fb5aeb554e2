"""DBSCAN on pixels: the labels of scikit-learn, found on the pixel grid instead of in a tree.

scikit-learn numbers clusters by their first core point and floods each one completely before the next, so a border
point belongs to the lowest number that reaches it. Events on one pixel share all their neighbours, hence their label:
flooding pixels in the order of their first events, counting each with its number of events, gives the same array.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros
from numpy.typing import NDArray

from core.detection.stages.cluster import ClusterConfig, scaled_time
from core.events import Events, SensorSize
from core.jit import njit

ONE: Final = np.uint64(1)


class PixelGrid(NamedTuple):
    """The pixels of some events on a grid with an empty margin, and their clusters."""

    numbers: NDArray[np.int32]
    """Number of its pixel + 1 in each cell, row by row; 0 where there is none."""
    stride: int
    """Cells from a row to the next."""
    disc: NDArray[np.int64]
    """(2, K) see `neighbour_rows`."""
    cells: NDArray[np.int32]
    """Cell of each pixel."""
    sizes: NDArray[np.int32]
    """Events of pixel k at k + 1; 0 at 0."""
    labels: NDArray[np.int32]
    """Cluster of each pixel, or of each event if time counts."""
    stack: NDArray[np.int32]
    """Room for what is still to be looked at."""


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
    pixel_of, cells, sizes, labels, stack, following = np.empty((6, count + 1), np.int32)
    pixels = _collect(events.x_px, events.y_px, grid, frame, pixel_of, cells, sizes)
    known = PixelGrid(grid, frame[0], rows, cells, sizes, labels, stack)
    if config.time_scale_px_per_ms > 0 and count:
        times = scaled_time(events.t_us, config.time_scale_px_per_ms)
        label_in_time(known, pixels, pixel_of, following, times, config.eps_px, config.min_samples)
        return labels[:count]
    label_pixels(known, pixels, np.zeros(len(grid) // 64 + 2, np.uint64), config.min_samples)
    return labels[pixel_of[:count]]


def grid_size(sensor: SensorSize, rows: NDArray[np.int64]) -> int:
    """Cells of a grid for a whole sensor with an empty margin as wide as the disc reaches."""
    margin = rows.shape[1] - 1
    return (sensor.width_px + margin) * (sensor.height_px + margin)


@njit
def grid_frame(x_min, x_max, y_min, rows):
    """Cells from a row to the next, and index of the cell of pixel (0, 0), of a grid that begins at (x_min, y_min).

    The margin makes bounds checks of neighbours superfluous. A grid as small as the events allow stays in the cache.
    """
    margin = rows.shape[1] // 2
    stride = x_max - x_min + 1 + 2 * margin
    return stride, (margin - y_min) * stride + margin - x_min


@njit
def add_event(grid, cell, cells, sizes, pixels):
    """Count an event at a cell. Returns the number of its pixel and how many pixels there are now.

    A cell holds the number of its pixel + 1, and `sizes` its events at that place, so that empty cells count sizes[0].
    """
    known = grid[cell]
    if known:
        sizes[known] += 1
        return known - 1, pixels
    grid[cell] = pixels + 1
    cells[pixels] = cell
    sizes[pixels + 1] = 1
    return pixels, pixels + 1


@njit
def _collect(x_px, y_px, grid, frame, pixel_of, cells, sizes):
    pixels = 0
    sizes[0] = 0
    stride, origin = frame
    for i in range(len(x_px)):
        pixel_of[i], pixels = add_event(grid, origin + y_px[i] * stride + x_px[i], cells, sizes, pixels)
    return pixels


@njit
def label_pixels(known, pixels, free, min_samples):
    """DBSCAN over the pixels of a `PixelGrid` in the order of their first events; returns the number of clusters.

    `free`, empty before and after, has a bit for each cell whose pixel has no label yet. The flood works on up to 64
    cells of a row at once: an entry of the queue is a first cell and a mask of the core pixels from there on.
    """
    grid, stride, rows, cells, sizes, labels, queue = known
    masks = np.empty(pixels, np.uint64)
    limit = 65 - rows.shape[1]  # a mask of more bits would lose some when it is widened
    for pixel in range(pixels):
        free[cells[pixel] >> 6] |= ONE << np.uint64(cells[pixel] & 63)
    labels[:pixels] = -1
    clusters = 0
    for seed in range(pixels):
        if labels[seed] != -1 or not _is_core(grid, stride, np.int64(cells[seed]), sizes, rows, min_samples):
            continue
        labels[seed] = clusters
        free[cells[seed] >> 6] &= ~(ONE << np.uint64(cells[seed] & 63))
        queue[0], masks[0] = cells[seed], ONE
        done, count = 0, 1
        while done < count:
            first, mask = np.int64(queue[done]), masks[done]
            done += 1
            while mask:
                part = mask & ((ONE << np.uint64(limit)) - ONE)
                for k in range(rows.shape[1]):
                    start = first + rows[0, k] * stride - rows[1, k]
                    found = _take(free, start, part, 2 * rows[1, k])
                    core = np.uint64(0)
                    while found:
                        place = trailing_zeros(found)  # pyright: ignore[reportCallIssue] - a numba intrinsic
                        found &= found - ONE
                        cell = start + np.int64(place)
                        labels[grid[cell] - 1] = clusters
                        if _is_core(grid, stride, cell, sizes, rows, min_samples):
                            core |= ONE << place
                    if core:
                        queue[count], masks[count] = start, core
                        count += 1
                mask >>= np.uint64(limit)
                first += limit
        clusters += 1
    for pixel in range(pixels):
        free[cells[pixel] >> 6] = 0
    return clusters


@njit(forceinline=True)
def _take(free, start, mask, widen_by):
    """The free cells from `start` on where the mask has a bit at most `widen_by` below; they are free no more."""
    word, shift = start >> 6, np.uint64(start & 63)
    rest = np.uint64(63) - shift
    found = (free[word] >> shift) | (free[word + 1] << ONE << rest)
    if found:
        smeared, wanted = ONE, np.uint64(widen_by + 1)
        while smeared < wanted:
            step = min(smeared, wanted - smeared)
            mask |= mask << step
            smeared += step
        found &= mask
        free[word] &= ~(found << shift)
        free[word + 1] &= ~(found >> ONE >> rest)
    return found


@njit(forceinline=True)
def _is_core(grid, stride, middle, sizes, rows, min_samples):
    near = 0
    for k in range(rows.shape[1]):
        # Unsigned, and no `for`: numba need not provide for negative places, nor the compiler for long rows.
        cell = np.uint64(middle + rows[0, k] * stride - rows[1, k])
        end = cell + np.uint64(2 * rows[1, k] + 1)
        while cell < end:
            near += sizes[np.uint64(grid[cell])]
            cell += ONE
        if near >= min_samples:
            return True
    return False


@njit
def label_in_time(known, pixels, pixel_of, following, times, eps, min_samples):
    """DBSCAN over the events of a `PixelGrid` with time as a third axis; returns the number of clusters.

    `sizes` and `following` are overwritten with the chain of events of each pixel.
    """
    count, heads, labels, stack = len(times), known.sizes, known.labels, known.stack
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
        found = _near_in_time(known, pixel_of, following, times, seed, eps, near)
        if found < min_samples:
            continue
        labels[seed] = clusters
        stack[0] = seed
        depth = 1
        while depth:
            depth -= 1
            found = _near_in_time(known, pixel_of, following, times, np.int64(stack[depth]), eps, near)
            if found < min_samples:
                continue
            for k in range(found):
                if labels[near[k]] == -1:
                    labels[near[k]] = clusters
                    stack[depth] = near[k]
                    depth += 1
        clusters += 1
    return clusters


@njit
def _near_in_time(known, pixel_of, following, times, event, eps, near):
    grid, stride, rows, cells, heads = known.numbers, known.stride, known.disc, known.cells, known.sizes
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
