"""One window through all stages in one compiled call: the same answer as the readable pipeline, without its trace."""

from __future__ import annotations

import numpy as np

from core.detection.fast.cluster import PixelGrid, add_event, grid_frame, label_in_time, label_pixels
from core.detection.fast.edges import measure_cluster, on_evidence_around
from core.detection.fast.memory import unpack_limits, unpack_memory
from core.detection.fast.opening import PAD_ROWS, open_bits
from core.detection.pipeline import SAME_CIRCULARITY
from core.jit import njit


@njit
def find_ball(
    t_us, x_px, y_px, on, whole, x_min, x_max, y_min, y_max, centre_u, centre_v, remembered,
    limit_values, answer, words, spans, grid, free, disc, per_row, per_event,
):  # fmt: skip
    """Look for the ball in the events inside the bounds, which lie on the sensor (`whole`: all events do).

    Returns the number of circles that passed every test; with at least one, `answer` holds the chosen one.
    """
    # So many arguments on purpose: as named tuples they cost each call 4 us more, of 12 to 20 us in all (measured).
    limits = unpack_limits(limit_values)
    memory = unpack_memory(words, spans, grid, free, disc, per_row, per_event)
    count = _survivors(x_px, y_px, whole, x_min, x_max, y_min, y_max, memory)
    if not count:
        return 0
    stride, pixels = _collect_pixels(x_px, y_px, count, memory)
    clusters = _label(t_us, count, pixels, stride, limits, memory)
    circles = 0
    best = np.inf
    for cluster in range(clusters):
        size = memory.starts[cluster + 1] - memory.starts[cluster]
        if size < limits.size_min or size > limits.size_max:
            continue
        leading_on, evidence = limits.leading > 0.0, 0.0
        if limits.leading == 0.0:
            evidence = on_evidence_around(t_us, x_px, y_px, on, cluster, clusters, limits.pair_radius_px, memory)
            leading_on = remembered + evidence >= 0.0
        circularity, u, v, r = measure_cluster(x_px, y_px, on, cluster, leading_on, limits, memory)
        if circularity < 0.0:
            continue
        circles += 1
        badness = -circularity if whole else (u - centre_u) ** 2 + (v - centre_v) ** 2
        if badness < best - SAME_CIRCULARITY:
            best = badness
            answer[0], answer[1], answer[2], answer[3] = u, v, r, evidence
    for pixel in range(pixels):
        grid[memory.cells[pixel]] = 0
    return circles


@njit
def _survivors(x_px, y_px, whole, x_min, x_max, y_min, y_max, memory):
    """Read the window once, open its binary image; fills memory.events, returns how many are left."""
    bits, opened, events = memory.bits, memory.opened, memory.events
    count = 0
    if whole:
        count = len(x_px)
        for i in range(count):
            events[i] = i
    else:
        for i in range(len(x_px)):
            events[count] = i  # written always, kept or overwritten by the next: no branch to mispredict
            count += (x_min <= x_px[i]) & (x_px[i] <= x_max) & (y_min <= y_px[i]) & (y_px[i] <= y_max)
    if len(memory.spans) == 1 or not count:
        return count
    for k in range(count):
        i = events[k]
        bits[y_px[i] + PAD_ROWS, (x_px[i] >> 6) + 1] |= np.uint64(1) << np.uint64(x_px[i] & 63)
    row_min, row_max = y_min + PAD_ROWS, y_max + PAD_ROWS
    first, last = open_bits(bits, opened, memory.spans, row_min, row_max)
    left = 0
    if first <= last:
        for k in range(count):
            i = events[k]
            events[left] = i
            row = y_px[i] + PAD_ROWS
            if first <= row <= last:
                left += ((opened[row, (x_px[i] >> 6) + 1] >> np.uint64(x_px[i] & 63)) & np.uint64(1)) != 0
        opened[first : last + 1] = 0
    bits[row_min : row_max + 1] = 0
    return left


@njit
def _collect_pixels(x_px, y_px, count, memory):
    """Number the pixels of the events in a grid just large enough; returns its stride and how many there are."""
    x_min, x_max, y_min = np.int64(1 << 30), np.int64(-1), np.int64(1 << 30)
    for k in range(count):
        x, y = np.int64(x_px[memory.events[k]]), np.int64(y_px[memory.events[k]])
        x_min, x_max, y_min = min(x_min, x), max(x_max, x), min(y_min, y)
    stride, origin = grid_frame(x_min, x_max, y_min, memory.disc)
    pixels = 0
    memory.sizes[0] = 0
    for k in range(count):
        i = memory.events[k]
        cell = origin + y_px[i] * stride + x_px[i]
        memory.pixel_of[k], pixels = add_event(memory.grid, cell, memory.cells, memory.sizes, pixels)
    return stride, pixels


@njit
def _label(t_us, count, pixels, stride, limits, memory):
    """Cluster, then sort the events by cluster into memory.order; returns the number of clusters."""
    labels, order, starts, pixel_of = memory.labels, memory.order, memory.starts, memory.pixel_of
    min_samples = int(limits.min_samples)  # compared in an inner loop: as a float it costs 10 us a window
    grid = PixelGrid(memory.grid, stride, memory.disc, memory.cells, memory.sizes, labels, memory.stack)
    timed = limits.time_scale_px_per_ms > 0.0
    if timed:
        times = np.empty(count)
        for k in range(count):
            times[k] = (t_us[memory.events[k]] - t_us[memory.events[0]]) * (limits.time_scale_px_per_ms / 1000.0)
        clusters = label_in_time(grid, pixels, pixel_of, order, times, limits.eps_px, min_samples)
    else:
        clusters = label_pixels(grid, pixels, memory.free, min_samples)
    starts[: clusters + 1] = 0
    for k in range(count):
        label = labels[k] if timed else labels[pixel_of[k]]
        if label >= 0:
            starts[label + 1] += 1
    for cluster in range(clusters):
        starts[cluster + 1] += starts[cluster]
        memory.stack[cluster] = starts[cluster]
    memory.seen[:pixels] = -1
    for k in range(count):
        label = labels[k] if timed else labels[pixel_of[k]]
        if label >= 0:
            order[memory.stack[label]] = k
            memory.stack[label] += 1
    return clusters
