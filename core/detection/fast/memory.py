"""What the compiled window needs beside the events: the limits and the arrays it works in, allocated once."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.config import DetectorConfig
from core.detection.fast.cluster import grid_size, neighbour_rows
from core.detection.fast.opening import blank_bits, kernel_spans
from core.events import SensorSize
from core.jit import njit

LEADING: Final = {"on": 1.0, "off": -1.0, "auto": 0.0}


class Limits(NamedTuple):
    """The thresholds of a config inside the compiled code."""

    eps_px: float
    min_samples: float
    time_scale_px_per_ms: float
    size_min: float
    size_max: float
    leading: float
    """1: ON, -1: OFF, 0: decided from the data."""
    pair_radius_px: float
    outlier_radius_px: float
    circularity_min: float
    solidity_min: float
    radius_min_px: float
    radius_max_px: float


class Memory(NamedTuple):
    """Working arrays inside the compiled code. `bits`, `opened`, `grid` and `free` are empty between windows."""

    bits: NDArray[np.uint64]
    opened: NDArray[np.uint64]
    spans: NDArray[np.int64]
    grid: NDArray[np.int32]
    free: NDArray[np.uint64]
    disc: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    """Leftmost and rightmost pixel of each row of the picture."""
    hull: NDArray[np.int64]
    events: NDArray[np.int32]
    """Row numbers of the events that are still in."""
    pixel_of: NDArray[np.int32]
    """Number of the pixel of each of those."""
    cells: NDArray[np.int32]
    """Grid cell of each pixel."""
    sizes: NDArray[np.int32]
    """Events of pixel k at k + 1; 0 at 0."""
    labels: NDArray[np.int32]
    """Cluster of each pixel, or of each event if time counts."""
    stack: NDArray[np.int32]
    order: NDArray[np.int32]
    """Places in `events`, cluster by cluster."""
    starts: NDArray[np.int32]
    """Where each cluster begins in `order`."""
    seen: NDArray[np.int32]
    """Last cluster that counted each pixel."""


Arrays = tuple[NDArray, NDArray, NDArray, NDArray, NDArray, NDArray, NDArray, NDArray, NDArray]
"""limits, answer, words, spans, grid, free, disc, per_row, per_event: few, since each costs a compiled call 80 ns."""


def allocate(config: DetectorConfig, sensor: SensorSize, room: int) -> Arrays:
    """Limits and working arrays for windows of up to `room` events."""
    limits = Limits(
        eps_px=config.cluster.eps_px,
        min_samples=config.cluster.min_samples,
        time_scale_px_per_ms=config.cluster.time_scale_px_per_ms,
        size_min=config.cluster.size_min,
        size_max=config.cluster.size_max,
        leading=LEADING[config.polarity.leading_polarity],
        pair_radius_px=config.polarity.pair_radius_px,
        outlier_radius_px=config.polarity.outlier_radius_px,
        circularity_min=config.geometry.circularity_min,
        solidity_min=config.geometry.solidity_min,
        radius_min_px=config.localise.radius_min_px,
        radius_max_px=config.localise.radius_max_px,
    )
    disc = neighbour_rows(config.cluster.eps_px)
    return (
        np.array(limits, np.float64),
        np.zeros(4),  # the answer: u, v, r of the chosen circle and its evidence that ON leads
        np.zeros((2, *blank_bits(sensor).shape), np.uint64),
        kernel_spans(config.denoise.kernel_px),
        np.zeros(grid_size(sensor, disc), np.int32),
        np.zeros(grid_size(sensor, disc) // 64 + 2, np.uint64),
        disc,
        np.zeros((6 * sensor.height_px + 4), np.int64),
        np.empty((9, room + 2), np.int32),
    )


@njit
def unpack_limits(a):
    """The named view of the array of limits."""
    return Limits(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11])


@njit
def unpack_memory(words, spans, grid, free, disc, per_row, per_event):
    """The named views of the working arrays."""
    e, height = per_event, (len(per_row) - 4) // 6
    hull = per_row[2 * height :].reshape(-1, 2)
    first, last = per_row[:height], per_row[height : 2 * height]
    lists = e[0], e[1], e[2], e[3], e[4], e[5], e[6], e[7], e[8]
    return Memory(words[0], words[1], spans, grid, free, disc, first, last, hull, *lists)
