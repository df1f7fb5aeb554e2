"""What the compiled window needs beside the events: the limits and the arrays it works in, allocated once."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.config import DetectorConfig
from core.detection.fast.clusters_in_time import TIME_LISTS
from core.detection.fast.opening import blank_bits, kernel_spans
from core.detection.fast.picture import SPOT_LISTS, ActivePixels, Picture, neighbour_rows, spots_of
from core.events import SensorSize
from core.jit import njit

LEADING: Final = {"on": 1.0, "off": -1.0, "auto": 0.0}
BIT_IMAGES: Final = 5
HEAD: Final = 7
"""Sizes in front of everything else."""
LISTS: Final = SPOT_LISTS + 2
"""Of 32-bit numbers with one for each event."""


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
    roi_expand_px: float
    width_px: float
    height_px: float
    memory_limit: float
    """Of the remembered evidence; 0 if nothing is remembered."""


LIMITS_END: Final = HEAD + len(Limits._fields)


class Memory(NamedTuple):
    """Working arrays inside the compiled code. The bit images are empty between windows."""

    bits: NDArray[np.uint64]
    opened: NDArray[np.uint64]
    picture: Picture
    """Of the pixels in `opened`."""
    found: ActivePixels
    spans: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    """Leftmost and rightmost pixel of each row of the picture."""
    hull: NDArray[np.int64]
    times: NDArray[np.int64]
    """(N, 4) of each pixel: sum of the times of its OFF events, of its ON events, and of their squares."""
    events: NDArray[np.int32]
    """Row numbers of the events that are still in."""
    touched: NDArray[np.int32]
    """Words of `bits` that are not empty."""
    in_time: NDArray[np.int32]
    """(3, N) for clusters in time, else without rows."""


def allocate(config: DetectorConfig, sensor: SensorSize, room: int) -> NDArray[np.int64]:
    """Limits and working arrays for windows of up to `room` events, in one piece.

    One, since each array costs a compiled call 80 ns, and 0.5 us when nothing is cached.
    """
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
        roi_expand_px=config.roi.roi_expand_px,
        width_px=sensor.width_px,
        height_px=sensor.height_px,
        memory_limit=config.polarity.memory_limit if config.polarity.memory_ms else 0.0,
    )
    spans, disc = kernel_spans(config.denoise.kernel_px), neighbour_rows(config.cluster.eps_px)
    rows, stride = blank_bits(sensor).shape
    lists = LISTS + (TIME_LISTS if config.cluster.time_scale_px_per_ms > 0 else 0)
    room = (room + 3) // 2 * 2
    head = np.array([len(spans), disc.shape[1], sensor.height_px, rows, stride, lists, room], np.int64)
    known = np.concatenate([head, np.array(limits, np.float64).view(np.int64), spans, disc.ravel()])
    size = len(known) + 6 * sensor.height_px + 4 + BIT_IMAGES * rows * stride + 5 * room + lists * room // 2
    memory = np.zeros(size, np.int64)
    memory[: len(known)] = known
    return memory


@njit
def unpack_limits(memory):
    """The thresholds in what `allocate` made."""
    a = memory[HEAD:LIMITS_END].view(np.float64)
    return Limits(
        a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], a[12], a[13], a[14], a[15]
    )  # fmt: skip


@njit
def unpack_memory(memory):
    """The working arrays in what `allocate` made."""
    n_spans, n_disc, height, rows, stride = memory[0], memory[1], memory[2], memory[3], memory[4]
    room, size = memory[6], rows * stride
    rest = memory[LIMITS_END:]
    spans, rest = rest[:n_spans], rest[n_spans:]
    disc, rest = rest[: 2 * n_disc].reshape((2, n_disc)), rest[2 * n_disc :]
    first, last, rest = rest[:height], rest[height : 2 * height], rest[2 * height :]
    hull, rest = rest[: 4 * height + 4].reshape((2 * height + 2, 2)), rest[4 * height + 4 :]
    times, rest = rest[: 4 * room].reshape((room, 4)), rest[4 * room :]
    masks, rest = rest[:room].view(np.uint64), rest[room:]
    words, rest = rest[: BIT_IMAGES * size].view(np.uint64).reshape((BIT_IMAGES, size)), rest[BIT_IMAGES * size :]
    bits, opened = words[0].reshape((rows, stride)), words[1].reshape((rows, stride))
    picture = Picture(words[1], words[2].view(np.int64), words[3], words[4], stride, disc)
    lists = rest.view(np.int32).reshape((memory[5], room))
    found, events, touched = spots_of(lists, masks), lists[SPOT_LISTS], lists[SPOT_LISTS + 1]
    return Memory(bits, opened, picture, found, spans, first, last, hull, times, events, touched, lists[LISTS:])
