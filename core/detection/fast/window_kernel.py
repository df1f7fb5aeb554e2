"""One window through all stages in one compiled call: the same answer as the readable pipeline, without its trace."""

from __future__ import annotations

import math

import numpy as np

from core.detection.fast.clusters_in_time import label_in_time, spots_of_clusters
from core.detection.fast.edges import cluster_sums, measure_cluster, on_evidence_around
from core.detection.fast.memory import unpack_limits, unpack_memory
from core.detection.fast.opening import PAD_ROWS, box_of, open_bits, set_bits
from core.detection.fast.picture import clear_picture, count_events, label_pixels
from core.detection.pipeline import SAME_CIRCULARITY
from core.jit import njit


@njit
def find_ball(t_us, x_px, y_px, on, centre_px, memory_of_leading, arrays):
    """Look for the ball in the region around a centre, on the whole sensor if that is not a number.

    Returns the number of circles that passed every test, u, v and r of the chosen one, the centre of the next region
    (Python's own rounding of u and v takes 10 us when nothing is cached), and the remembered evidence that ON leads.
    That and how much of it is left after the window is `memory_of_leading`.
    """
    limits, memory = unpack_limits(arrays), unpack_memory(arrays)
    (centre_u, centre_v), (remembered, fading) = centre_px, memory_of_leading
    whole = math.isnan(centre_u)
    circles, u, v, r, evidence = 0, 0.0, 0.0, 0.0, 0.0
    count = _in_region(x_px, y_px, whole, centre_u, centre_v, limits, memory.events)
    count, box = _survivors(x_px, y_px, count, memory)
    if not count:
        return circles, u, v, r, centre_px, _remember(remembered * fading, limits.memory_limit)
    clusters = _label(t_us, x_px, y_px, on, memory.events[:count], box, limits, memory)
    found = memory.found
    best = np.inf
    for cluster in range(clusters):
        sums, rows = cluster_sums(cluster, found)
        size = sums[0][0] + sums[1][0]
        if size < limits.size_min or size > limits.size_max:
            continue
        leading_on, shown = limits.leading > 0.0, 0.0
        if limits.leading == 0.0:
            centre_x, centre_y = (sums[0][1] + sums[1][1]) / size, (sums[0][2] + sums[1][2]) / size
            clustered = found.starts[clusters]
            shown = on_evidence_around(centre_x, centre_y, clustered, limits.pair_radius_px, found, memory.times)
            leading_on = remembered + shown >= 0.0
        count, sum_x, sum_y = sums[1] if leading_on else sums[0]
        if not count:
            continue
        centre_px, side = (sum_x / count, sum_y / count), 1 if leading_on else 0
        circularity, cluster_u, cluster_v, cluster_r = measure_cluster(cluster, side, centre_px, rows, limits, memory)
        if circularity < 0.0:
            continue
        circles += 1
        badness = -circularity if whole else (cluster_u - centre_u) ** 2 + (cluster_v - centre_v) ** 2
        if badness < best - SAME_CIRCULARITY:
            best = badness
            u, v, r, evidence = cluster_u, cluster_v, cluster_r, shown
    remembered = _remember(remembered * fading + evidence, limits.memory_limit)
    return circles, u, v, r, (rounded(u), rounded(v)), remembered


@njit
def _remember(evidence, limit):
    return max(-limit, min(limit, evidence))


@njit
def rounded(x):
    """Exactly Python's round(x, 2)."""
    below = math.floor(x * 100.0)
    # How far 200 x lies above the odd number halfway between two hundredths. Both parts of x times 200 are exact, and
    # where the sign is in doubt so is the difference.
    upper = np.float64(np.float32(x))
    beyond = (upper * 200.0 - (2.0 * below + 1.0)) + (x - upper) * 200.0
    if beyond > 0.0 or (beyond == 0.0 and below % 2):
        below += 1
    return below / 100.0


@njit
def _in_region(x_px, y_px, whole, centre_u, centre_v, limits, events):
    """Fills `events` with the rows of those inside; returns how many they are."""
    if whole:
        for i in range(len(x_px)):
            events[i] = i
        return len(x_px)
    expand = limits.roi_expand_px
    x_min, x_max = max(0, math.ceil(centre_u - expand)), min(limits.width_px - 1, math.floor(centre_u + expand))
    y_min, y_max = max(0, math.ceil(centre_v - expand)), min(limits.height_px - 1, math.floor(centre_v + expand))
    if x_min > x_max or y_min > y_max:
        return 0
    left, top = np.int64(x_min), np.int64(y_min)
    width, height = np.uint64(x_max - x_min), np.uint64(y_max - y_min)
    count = np.uint64(0)
    for i in range(len(x_px)):
        events[count] = i  # written always, kept or overwritten by the next: no branch to mispredict
        # What lies left of or above the region becomes a huge number without a sign.
        count += np.uint64((np.uint64(x_px[i] - left) <= width) & (np.uint64(y_px[i] - top) <= height))
    return np.int64(count)


@njit
def _survivors(x_px, y_px, count, memory):
    """Open the binary image of memory.events into memory.opened.

    Keeps the events on it; returns how many and the box of words with pixels, see `open_bits`.
    """
    bits, opened, events, touched = memory.bits, memory.opened, memory.events, memory.touched
    stride = opened.shape[1]
    if len(memory.spans) == 1:
        words = set_bits(x_px, y_px, events, count, opened, touched)
        return count, box_of(touched[:words], stride)
    words = set_bits(x_px, y_px, events, count, bits, touched)
    box = open_bits(bits, opened, memory.spans, touched[:words])
    flat = bits.reshape(-1)
    for k in range(words):
        flat[touched[k]] = 0
    left = np.uint64(0)
    first, rows = box[0], np.uint64(max(0, box[1] - box[0]))
    if box[0] > box[1]:
        return 0, box
    flat = opened.reshape(-1)
    for k in range(count):
        i = np.uint64(events[k])
        row = y_px[i] + PAD_ROWS
        events[left] = events[k]
        # Outside these rows the first word of all is looked at, which is empty: no branch, and little to fetch.
        place = np.uint64(row * stride + (x_px[i] >> 6) + 1) * np.uint64(np.uint64(row - first) <= rows)
        left += (flat[place] >> np.uint64(x_px[i] & 63)) & np.uint64(1)
    return np.int64(left), box


@njit
def _label(t_us, x_px, y_px, on, events, box, limits, memory):
    """Cluster the events that are left; returns the number of clusters, which are in memory.found."""
    picture, found = memory.picture, memory.found
    count, min_samples = len(events), np.int64(limits.min_samples)
    pixels = count_events(x_px, y_px, on, events, box, picture, found)
    if limits.time_scale_px_per_ms > 0.0:
        times = np.empty(count)
        for k in range(count):
            times[k] = (t_us[events[k]] - t_us[events[0]]) * (limits.time_scale_px_per_ms / 1000.0)
        clusters = label_in_time(times, pixels, box, picture, found, memory.in_time, limits.eps_px, min_samples)
        spots_of_clusters(t_us, on, events, clusters, found, memory.times, memory.in_time)
    else:
        clusters = label_pixels(count, pixels, box, picture, found, min_samples)
        if limits.leading == 0.0:
            _sum_times(t_us, on, events, found.pixel_of, memory.times[:pixels])
    clear_picture(box, picture)
    return clusters


@njit
def _sum_times(t_us, on, events, pixel_of, sums):
    """Fills the sums of the times of each pixel, see `Memory.times`."""
    sums[:] = 0
    for k in range(len(events)):
        i = events[k]
        side, t = 1 if on[i] else 0, t_us[i] - t_us[0]
        sums[pixel_of[k], side] += t
        sums[pixel_of[k], 2 + side] += t * t
