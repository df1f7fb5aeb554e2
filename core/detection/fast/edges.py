"""Polarity, geometry and circle of one cluster, compiled: the stages of those names without arrays of rows."""

from __future__ import annotations

import math

import numpy as np

from core.detection.fast.shape import area_and_perimeter, circle_of_hull, hull_of_rows
from core.detection.stages.localise import TOLERANCE_PX
from core.detection.stages.polarity import MIN_EVENTS, MIN_SPREAD
from core.jit import njit


@njit
def on_evidence_around(t_us, x_px, y_px, on, cluster, clusters, radius, memory):
    """`polarity.on_evidence` of the clustered events around the centroid of a cluster."""
    start, end = memory.starts[cluster], memory.starts[cluster + 1]
    sum_x, sum_y = 0, 0
    for place in range(start, end):
        i = memory.events[memory.order[place]]
        sum_x += x_px[i]
        sum_y += y_px[i]
    centre_x, centre_y = sum_x / (end - start), sum_y / (end - start)
    # Whole numbers near 0: their sums are exact.
    origin_x, origin_y, origin_t = np.int64(centre_x), np.int64(centre_y), t_us[0]
    sums = np.zeros((2, 10))
    for place in range(memory.starts[clusters]):
        i = memory.events[memory.order[place]]
        off_x, off_y = x_px[i] - centre_x, y_px[i] - centre_y
        if off_x * off_x + off_y * off_y <= radius * radius:
            side = sums[1 if on[i] else 0]
            t, x, y = t_us[i] - origin_t, np.int64(x_px[i]) - origin_x, np.int64(y_px[i]) - origin_y
            side[0] += 1
            side[1] += t
            side[2] += x
            side[3] += y
            side[4] += t * t
            side[5] += t * x
            side[6] += t * y
            side[7] += x * x
            side[8] += x * y
            side[9] += y * y
    return _correlation(sums)


@njit
def _correlation(sums):
    """Of time with position along the line between the polarities, within each, times sqrt(N). From sums per side:
    N, t, x, y, tt, tx, ty, xx, xy, yy.
    """
    off, on = sums[0], sums[1]
    if off[0] < MIN_EVENTS or on[0] < MIN_EVENTS:
        return 0.0
    du, dv = on[2] / on[0] - off[2] / off[0], on[3] / on[0] - off[3] / off[0]
    tt, tq, qq = 0.0, 0.0, 0.0
    for k in range(2):
        n, t, x, y = sums[k, 0], sums[k, 1], sums[k, 2], sums[k, 3]
        tt += sums[k, 4] - t * t / n
        tq += du * (sums[k, 5] - t * x / n) + dv * (sums[k, 6] - t * y / n)
        xx, xy, yy = sums[k, 7] - x * x / n, sums[k, 8] - x * y / n, sums[k, 9] - y * y / n
        qq += du * du * xx + 2.0 * du * dv * xy + dv * dv * yy
    if min(tt, qq) <= MIN_SPREAD:
        return 0.0
    return math.sqrt(off[0] + on[0]) * tq / math.sqrt(tt * qq)


@njit
def measure_cluster(x_px, y_px, on, cluster, leading_on, limits, memory):
    """Circularity, u, v, r of the leading edge of a cluster; circularity -1 if it is no ball."""
    nothing = -1.0, 0.0, 0.0, 0.0
    pixels, y_min, y_max = _mark_leading_edge(x_px, y_px, on, cluster, leading_on, limits.outlier_radius_px, memory)
    if not pixels:
        return nothing
    corners = hull_of_rows(memory.first, memory.last, y_min, y_max, memory.hull)
    area, perimeter = area_and_perimeter(memory.hull, corners)
    circularity, solidity = 0.0, 0.0
    if area > 0.0:
        circularity = 4.0 * np.pi * area / (perimeter * perimeter)
        solidity = pixels / area
    if circularity < limits.circularity_min or solidity < limits.solidity_min:
        return nothing
    u, v, r = circle_of_hull(memory.hull, corners)
    if r < limits.radius_min_px - TOLERANCE_PX or r > limits.radius_max_px + TOLERANCE_PX:
        return nothing
    return circularity, u, v, r


@njit
def _mark_leading_edge(x_px, y_px, on, cluster, leading_on, radius, memory):
    """Sets memory.first and .last of the rows of the leading events near their centroid.

    Returns how many pixels those events occupy, and their first and last row.
    """
    start, end = memory.starts[cluster], memory.starts[cluster + 1]
    count, sum_x, sum_y = 0, 0, 0
    y_min, y_max = np.int64(1 << 30), np.int64(-1)
    for place in range(start, end):
        i = memory.events[memory.order[place]]
        if on[i] == leading_on:
            count += 1
            sum_x += x_px[i]
            sum_y += y_px[i]
            y_min, y_max = min(y_min, np.int64(y_px[i])), max(y_max, np.int64(y_px[i]))
    if not count:
        return 0, 0, 0
    memory.first[y_min : y_max + 1] = 1 << 30
    memory.last[y_min : y_max + 1] = -1
    centre_x, centre_y = sum_x / count, sum_y / count
    pixels = 0
    for place in range(start, end):
        k = memory.order[place]
        i = memory.events[k]
        if on[i] != leading_on:
            continue
        off_x, off_y = x_px[i] - centre_x, y_px[i] - centre_y
        if off_x * off_x + off_y * off_y > radius * radius:
            continue
        x, y = np.int64(x_px[i]), np.int64(y_px[i])
        memory.first[y] = min(memory.first[y], x)
        memory.last[y] = max(memory.last[y], x)
        pixel = memory.pixel_of[k]
        if memory.seen[pixel] != cluster:
            memory.seen[pixel] = cluster
            pixels += 1
    return pixels, y_min, y_max
