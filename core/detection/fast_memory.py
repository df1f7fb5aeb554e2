"""What the compiled window needs beside the events: the limits and the arrays it works in, allocated once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.config import DetectorConfig
from core.detection.fast_cluster import blank_grid, grid_stride, neighbour_rows
from core.detection.fast_opening import blank_bits, kernel_spans
from core.events import SensorSize

LEADING = {"on": 1, "off": -1, "auto": 0}


class Limits(NamedTuple):
    """The thresholds of a config as the compiled code takes them; a named tuple because numba knows those."""

    eps_px: float
    min_samples: int
    time_scale_px_per_ms: float
    size_min: int
    size_max: int
    leading: int
    """1: ON, -1: OFF, 0: decided from the data."""
    pair_radius_px: float
    outlier_radius_px: float
    circularity_min: float
    solidity_min: float
    radius_min_px: float
    radius_max_px: float


class Memory(NamedTuple):
    """Working arrays. `bits`, `opened` and `grid` are empty before and after every window."""

    bits: NDArray[np.uint64]
    opened: NDArray[np.uint64]
    spans: NDArray[np.int64]
    grid: NDArray[np.int32]
    stride: int
    rows: NDArray[np.int64]
    events: NDArray[np.int32]
    """Row numbers of the events that are still in."""
    pixel_of: NDArray[np.int32]
    """Number of the pixel of each of those."""
    cells: NDArray[np.int32]
    sizes: NDArray[np.int32]
    labels: NDArray[np.int32]
    """Cluster of each pixel, or of each event if time counts."""
    stack: NDArray[np.int32]
    order: NDArray[np.int32]
    """Places in `events`, cluster by cluster."""
    starts: NDArray[np.int32]
    """Where each cluster begins in `order`."""
    seen: NDArray[np.int32]
    """Last cluster that counted each pixel."""
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    """Leftmost and rightmost pixel of each row of the picture."""
    hull: NDArray[np.int64]
    answer: NDArray[np.float64]
    """u, v, r of the chosen circle and its evidence that ON leads."""


def limits_of(config: DetectorConfig) -> Limits:
    """The thresholds of a config."""
    return Limits(
        eps_px=float(config.cluster.eps_px),
        min_samples=config.cluster.min_samples,
        time_scale_px_per_ms=float(config.cluster.time_scale_px_per_ms),
        size_min=config.cluster.size_min,
        size_max=config.cluster.size_max,
        leading=LEADING[config.polarity.leading_polarity],
        pair_radius_px=float(config.polarity.pair_radius_px),
        outlier_radius_px=float(config.polarity.outlier_radius_px),
        circularity_min=float(config.geometry.circularity_min),
        solidity_min=float(config.geometry.solidity_min),
        radius_min_px=float(config.localise.radius_min_px),
        radius_max_px=float(config.localise.radius_max_px),
    )


def allocate(config: DetectorConfig, sensor: SensorSize, events: int) -> Memory:
    """Working arrays for windows of up to `events` events."""
    per_event = np.empty((8, events + 1), np.int32)
    return Memory(
        bits=blank_bits(sensor),
        opened=blank_bits(sensor),
        spans=kernel_spans(config.denoise.kernel_px),
        grid=blank_grid(sensor),
        stride=grid_stride(sensor),
        rows=neighbour_rows(config.cluster.eps_px),
        events=per_event[0],
        pixel_of=per_event[1],
        cells=per_event[2],
        sizes=per_event[3],
        labels=per_event[4],
        stack=per_event[5],
        order=per_event[6],
        starts=per_event[7],
        seen=np.empty(events + 1, np.int32),
        first=np.empty(sensor.height_px, np.int64),
        last=np.empty(sensor.height_px, np.int64),
        hull=np.empty((2 * sensor.height_px + 2, 2), np.int64),
        answer=np.zeros(4),
    )
