"""Polarity, geometry and circle of one cluster, compiled: the stages of those names without arrays of rows."""

from __future__ import annotations

import math

import numpy as np

from core.detection.fast.shape import area_and_perimeter, circle_of_hull, hull_of_rows
from core.detection.stages.localise import TOLERANCE_PX
from core.detection.stages.polarity import MIN_EVENTS, MIN_SPREAD
from core.jit import njit


@njit
def cluster_sums(cluster, found):
    """(2, 3) of its OFF and of its ON events: how many, sum of x, sum of y. And the first and last row of all."""
    off, off_x, off_y, on, on_x, on_y = 0, 0, 0, 0, 0, 0
    y_min, y_max = np.int64(1 << 30), np.int64(-1)
    for place in range(found.starts[cluster], found.starts[cluster + 1]):
        pixel = np.uint64(found.members[place])
        x, y = np.int64(found.spots[pixel, 0]), np.int64(found.spots[pixel, 1])
        n_off, n_on = np.int64(found.spots[pixel, 2]), np.int64(found.spots[pixel, 3])
        off += n_off
        off_x += n_off * x
        off_y += n_off * y
        on += n_on
        on_x += n_on * x
        on_y += n_on * y
        y_min, y_max = min(y_min, y), max(y_max, y)
    return ((off, off_x, off_y), (on, on_x, on_y)), (y_min, y_max)


@njit
def on_evidence_around(centre_x, centre_y, clustered, radius, found, times):
    """`polarity.on_evidence` of the events on the pixels of all clusters around a centroid."""
    # Whole numbers near 0: their sums are exact.
    origin_x, origin_y = np.int64(centre_x), np.int64(centre_y)
    sums = np.zeros((2, 10))
    for place in range(clustered):
        pixel = np.uint64(found.members[place])
        x, y = np.int64(found.spots[pixel, 0]), np.int64(found.spots[pixel, 1])
        off_x, off_y = x - centre_x, y - centre_y
        if off_x * off_x + off_y * off_y <= radius * radius:
            x, y = x - origin_x, y - origin_y
            for side in range(2):
                n, t = np.int64(found.spots[pixel, 2 + side]), times[pixel, side]
                if not n:
                    continue
                sums[side, 0] += n
                sums[side, 1] += t
                sums[side, 2] += n * x
                sums[side, 3] += n * y
                sums[side, 4] += times[pixel, 2 + side]
                sums[side, 5] += t * x
                sums[side, 6] += t * y
                sums[side, 7] += n * x * x
                sums[side, 8] += n * x * y
                sums[side, 9] += n * y * y
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
def measure_cluster(cluster, side, centre_px, rows, limits, memory):
    """Circularity, u, v, r of the leading edge of a cluster; circularity -1 if it is no ball.

    `side` is 1 if ON leads, `centre_px` the centroid of the leading events, `rows` hold the whole cluster.
    """
    nothing = -1.0, 0.0, 0.0, 0.0
    found, first, last, (y_min, y_max) = memory.found, memory.first, memory.last, rows
    for y in range(y_min, y_max + 1):
        first[y], last[y] = 1 << 30, -1
    pixels, (centre_x, centre_y), radius = 0, centre_px, limits.outlier_radius_px
    for place in range(found.starts[cluster], found.starts[cluster + 1]):
        pixel = np.uint64(found.members[place])
        x, y = np.int64(found.spots[pixel, 0]), np.uint64(found.spots[pixel, 1])
        off_x, off_y = x - centre_x, y - centre_y
        if (found.spots[pixel, 2 + side] != 0) & (off_x * off_x + off_y * off_y <= radius * radius):
            first[y], last[y] = min(first[y], x), max(last[y], x)
            pixels += 1
    if not pixels:
        return nothing
    corners = hull_of_rows(first, last, y_min, y_max, memory.hull)
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
