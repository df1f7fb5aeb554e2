"""Search for moving objects: pixels that survive an opening over several time spans, joined to blobs of cells.

A ball whose edge sweeps three pixels or more leaves crescents that survive; fast ones in the shortest span, slow ones
in the longest. Only pixels with new events are tested, against a map of the last event of every pixel.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.refined.history import Recent
from core.events import SensorSize
from core.jit import njit

SPANS_US: Final = np.array([1500, 5000, 16_000], np.int64)
"""Time spans for which a pixel counts as set."""
CELL_BITS: Final = 2
"""A cell is 4 x 4 pixels."""
CELL_PX: Final = 1 << CELL_BITS
MAX_BLOBS: Final = 64
LONG_AGO_US: Final = -(1 << 60)


class Maps(NamedTuple):
    """State of the search for every pixel and cell."""

    last_us: NDArray[np.int64]
    """(height + 2, width + 2) last event of each pixel, with a border."""
    cells_us: NDArray[np.int64]
    """(spans, rows + 2, columns + 2) when a pixel of the cell last survived."""
    visited: NDArray[np.int32]
    """(rows + 2, columns + 2) number of the last flood fill that visited the cell."""
    stack: NDArray[np.int32]


class BlobLimits(NamedTuple):
    """What a blob must keep to be examined."""

    side_max_px: float
    """Longest side of its box."""
    elongation_max: float
    """Largest ratio of its sides, after one cell."""


class Blobs(NamedTuple):
    """Boxes of cells, in pixels."""

    boxes: NDArray[np.float64]
    """(MOST_BLOBS, 4): u and v of the middle, width, height."""
    span: NDArray[np.int64]
    """(MOST_BLOBS,) index into SPANS_US."""
    rejected: NDArray[np.float64]
    """(6,) the largest blob that is beyond a limit: u and v of the middle, width, height, cells, index into SPANS_US.
    0 cells: there is none."""


def blank_maps(sensor: SensorSize) -> Maps:
    """Empty maps."""
    rows, columns = (sensor.height_px >> CELL_BITS) + 3, (sensor.width_px >> CELL_BITS) + 3
    return Maps(
        np.full((sensor.height_px + 2, sensor.width_px + 2), LONG_AGO_US, np.int64),
        np.full((len(SPANS_US), rows, columns), LONG_AGO_US, np.int64),
        np.zeros((rows, columns), np.int32),
        np.zeros(rows * columns, np.int32),
    )


def blank_blobs() -> Blobs:
    """Arrays for the blobs of one search."""
    return Blobs(np.zeros((MAX_BLOBS, 4)), np.zeros(MAX_BLOBS, np.int64), np.zeros(6))


@njit
def take_events(recent: Recent, since_us: int, maps: Maps, neighbours_min: int) -> None:
    """Update the maps with new events; a pixel survives with so many neighbours."""
    last_us, cells_us = maps.last_us, maps.cells_us
    begin = np.searchsorted(recent.t_us, since_us)
    for k in range(begin, len(recent.t_us)):
        last_us[recent.y_px[k] + 1, recent.x_px[k] + 1] = recent.t_us[k]
    for k in range(begin, len(recent.t_us)):
        row, column, t_us = recent.y_px[k] + 1, recent.x_px[k] + 1, recent.t_us[k]
        for span in range(len(SPANS_US)):
            if _survives(last_us, row, column, t_us - SPANS_US[span], neighbours_min):
                cells_us[span, ((row - 1) >> CELL_BITS) + 1, ((column - 1) >> CELL_BITS) + 1] = t_us


@njit
def _survives(last_us, row, column, since_us, neighbours_min):
    """Whether all but one of the cross round the pixel are set, and enough of its eight neighbours."""
    cross = 0
    corners = 0
    if last_us[row - 1, column] >= since_us:
        cross += 1
    if last_us[row + 1, column] >= since_us:
        cross += 1
    if last_us[row, column - 1] >= since_us:
        cross += 1
    if last_us[row, column + 1] >= since_us:
        cross += 1
    if cross < 3:
        return False
    if last_us[row - 1, column - 1] >= since_us:
        corners += 1
    if last_us[row - 1, column + 1] >= since_us:
        corners += 1
    if last_us[row + 1, column - 1] >= since_us:
        corners += 1
    if last_us[row + 1, column + 1] >= since_us:
        corners += 1
    return cross + corners >= neighbours_min


@njit
def surviving_events(recent: Recent, end_us: int, span_us: int, maps: Maps, neighbours_min: int) -> NDArray[np.bool_]:
    """(N,) events whose pixels survive the opening over a time span that ends at `end_us`, for a trace of the search.

    The search itself tests each pixel once, at the time of its event.
    """
    survives = np.zeros(len(recent.t_us), np.bool_)
    since_us = end_us - span_us
    for k in range(np.searchsorted(recent.t_us, since_us), len(recent.t_us)):
        survives[k] = _survives(maps.last_us, recent.y_px[k] + 1, recent.x_px[k] + 1, since_us, neighbours_min)
    return survives


@njit
def find_blobs(maps: Maps, span: int, end_us: int, flood: int, limits: BlobLimits, blobs: Blobs, found: int) -> int:
    """Add the blobs of one span that could be a ball to those found; how many there are then.

    `flood` must be a number that no flood had before. The largest blob beyond a limit is kept in `blobs.rejected`.
    """
    cells_us, visited, stack = maps.cells_us[span], maps.visited, maps.stack
    rows, columns = cells_us.shape
    since_us = end_us - SPANS_US[span]
    size = 1 << CELL_BITS
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            if cells_us[row, column] < since_us or visited[row, column] == flood:
                continue
            top, bottom, left, right = row, row, column, column
            visited[row, column] = flood
            stack[0] = row * columns + column
            depth, cells = 1, 0
            while depth:
                depth -= 1
                r, c = divmod(stack[depth], columns)
                cells += 1
                top, bottom, left, right = min(top, r), max(bottom, r), min(left, c), max(right, c)
                for i in range(max(1, r - 1), min(rows - 1, r + 2)):
                    for j in range(max(1, c - 1), min(columns - 1, c + 2)):
                        if cells_us[i, j] >= since_us and visited[i, j] != flood:
                            visited[i, j] = flood
                            stack[depth] = i * columns + j
                            depth += 1
            width, height = (right - left + 1) * size, (bottom - top + 1) * size
            longer, shorter = max(width, height), min(width, height)
            # A cell is 4 x 4 px, less than the smallest ball fills.
            if cells < 2 or found >= MAX_BLOBS:
                continue
            # One cell less for the map's empty border; half a pixel less as a pixel's address is its centre.
            u, v = (left - 1) * size + 0.5 * width - 0.5, (top - 1) * size + 0.5 * height - 0.5
            # A cell more, by which the sides are rounded up.
            if longer > limits.side_max_px or longer > limits.elongation_max * shorter + size:
                if cells > blobs.rejected[4]:
                    blobs.rejected[0], blobs.rejected[1] = u, v
                    blobs.rejected[2], blobs.rejected[3] = width, height
                    blobs.rejected[4], blobs.rejected[5] = cells, span
                continue
            blobs.boxes[found, 0], blobs.boxes[found, 1] = u, v
            blobs.boxes[found, 2], blobs.boxes[found, 3] = width, height
            blobs.span[found] = span
            found += 1
    return found
