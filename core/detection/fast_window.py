"""One window through all stages in one compiled call: the same answer as the readable pipeline, without its trace."""

from __future__ import annotations

import numpy as np
from numba import njit

from core.detection.fast_cluster import add_event, cell_of, label_in_time, label_pixels
from core.detection.fast_edges import measure_cluster, on_evidence_around
from core.detection.fast_opening import ONE, PAD_ROWS, open_bits
from core.detection.pipeline import SAME_CIRCULARITY


@njit(cache=True, nogil=True)
def find_ball(t_us, x_px, y_px, on, whole, x_min, x_max, y_min, y_max, centre_u, centre_v, remembered, limits, memory):
    """Look for the ball in the events inside the bounds (clipped to the sensor; `whole`: all events are).

    Returns the number of circles that passed every test; with at least one, memory.answer holds the chosen one.
    """
    count = _survivors(x_px, y_px, whole, x_min, x_max, y_min, y_max, memory)
    if not count:
        return 0
    pixels = 0
    for k in range(count):
        i = memory.events[k]
        cell = cell_of(x_px[i], y_px[i], memory.stride)
        memory.pixel_of[k], pixels = add_event(memory.grid, cell, memory.cells, memory.sizes, pixels)
    clusters = _label(t_us, count, pixels, limits, memory)
    circles = 0
    best = np.inf
    for cluster in range(clusters):
        size = memory.starts[cluster + 1] - memory.starts[cluster]
        if size < limits.size_min or size > limits.size_max:
            continue
        leading_on, evidence = limits.leading > 0, 0.0
        if limits.leading == 0:
            evidence = on_evidence_around(t_us, x_px, y_px, on, cluster, clusters, limits.pair_radius_px, memory)
            leading_on = remembered + evidence >= 0.0
        circularity, u, v, r = measure_cluster(x_px, y_px, on, cluster, leading_on, limits, memory)
        if circularity < 0.0:
            continue
        circles += 1
        badness = -circularity if whole else (u - centre_u) ** 2 + (v - centre_v) ** 2
        if badness < best - SAME_CIRCULARITY:
            best = badness
            answer = memory.answer
            answer[0], answer[1], answer[2], answer[3] = u, v, r, evidence
    for pixel in range(pixels):
        memory.grid[memory.cells[pixel]] = 0
    return circles


@njit(cache=True, nogil=True)
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
        bits[y_px[i] + PAD_ROWS, (x_px[i] >> 6) + 1] |= ONE << np.uint64(x_px[i] & 63)
    row_min, row_max, word_min, word_max = y_min + PAD_ROWS, y_max + PAD_ROWS, (x_min >> 6) + 1, (x_max >> 6) + 1
    left = 0
    if open_bits(bits, opened, memory.spans, row_min, row_max, word_min, word_max):
        for k in range(count):
            i = events[k]
            events[left] = i
            left += (opened[y_px[i] + PAD_ROWS, (x_px[i] >> 6) + 1] >> np.uint64(x_px[i] & 63)) & ONE == ONE
        opened[row_min - PAD_ROWS : row_max + PAD_ROWS + 1, word_min - 1 : word_max + 2] = 0
    bits[row_min : row_max + 1, word_min : word_max + 1] = 0
    return left


@njit(cache=True, nogil=True)
def _label(t_us, count, pixels, limits, memory):
    """Cluster, then sort the events by cluster into memory.order; returns the number of clusters."""
    labels, order, starts, pixel_of = memory.labels, memory.order, memory.starts, memory.pixel_of
    timed = limits.time_scale_px_per_ms > 0.0
    if timed:
        times = np.empty(count)
        for k in range(count):
            times[k] = (t_us[memory.events[k]] - t_us[memory.events[0]]) * (limits.time_scale_px_per_ms / 1000.0)
        clusters = label_in_time(
            times, memory.grid, memory.stride, pixel_of, memory.cells, pixels, memory.sizes, order, memory.rows,
            limits.eps_px, limits.min_samples, labels, memory.stack,
        )  # fmt: skip
    else:
        clusters = label_pixels(
            memory.grid, memory.stride, memory.cells, memory.sizes, pixels, memory.rows, limits.min_samples, labels,
            memory.stack,
        )  # fmt: skip
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
