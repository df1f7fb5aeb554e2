"""One window through all stages in one compiled call: the same answer as the readable pipeline, without its trace.

Hull, circularity, solidity and minimum enclosing circle of a set of pixels, from its leftmost and rightmost ones.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.fast.cluster import ClusterMemory, label_events
from core.detection.pipeline import SAME_CIRCULARITY
from core.detection.stages.localise import TOLERANCE_PX
from core.detection.stages.polarity import MIN_EVENTS, MIN_SPREAD
from core.jit import njit


@njit
def hull_of_rows(first, last, y_min, y_max, hull):
    """Corners of the convex hull of the pixels between first[y] and last[y] of each row, counter-clockwise.

    Rows without pixels have first > last. Fills hull[:K] (x, y; K up to 2 * rows) and returns K; no three corners lie
    on a line.
    """
    count = 0
    for y in range(y_min, y_max + 1):
        if first[y] <= last[y]:
            count = _push(hull, count, 0, first[y], y)
    # The lowest corner so far starts the way back up along the right side.
    bottom = count - 1
    for y in range(y_max, y_min - 1, -1):
        if first[y] <= last[y]:
            count = _push(hull, count, bottom, last[y], y)
    if count > 2 and hull[count - 1, 0] == hull[0, 0] and hull[count - 1, 1] == hull[0, 1]:
        count -= 1
    return count


@njit
def _push(hull, count, floor, x, y):
    """Add a point to a chain that turns one way only, taking back corners down to `floor` that it makes superfluous."""
    if count and hull[count - 1, 0] == x and hull[count - 1, 1] == y:
        return count
    while count - 1 > floor:
        ax, ay = hull[count - 2, 0], hull[count - 2, 1]
        bx, by = hull[count - 1, 0], hull[count - 1, 1]
        if (bx - ax) * (y - ay) - (by - ay) * (x - ax) < 0:
            break
        count -= 1
    hull[count, 0] = x
    hull[count, 1] = y
    return count + 1


@njit
def area_and_perimeter(hull, count):
    """Area and perimeter of the polygon hull[:count]."""
    twice_area = 0
    perimeter = 0.0
    for k in range(count):
        following = k + 1 if k + 1 < count else 0
        dx, dy = hull[following, 0] - hull[k, 0], hull[following, 1] - hull[k, 1]
        twice_area += hull[k, 0] * hull[following, 1] - hull[following, 0] * hull[k, 1]
        perimeter += math.sqrt(dx * dx + dy * dy)
    return 0.5 * abs(twice_area), perimeter


@njit
def circle_of_hull(hull, count):
    """Minimum enclosing circle (u, v, r) of a convex polygon without three corners on a line.

    From a side: the corner that sees it under the smallest angle. If that angle is not acute, the side is the
    diameter; if the triangle has no obtuse angle, its circumcircle is the answer; else go on with the side opposite
    the obtuse angle. The circle grows in every step, so it ends.
    """
    if count == 1:
        return float(hull[0, 0]), float(hull[0, 1]), 0.0
    a, b = 0, 1
    while True:
        # The largest cotangent is the smallest angle, without a call of atan2.
        c, angle = -1, -np.inf
        for k in range(count):
            if k in (a, b):
                continue
            cotangent = _cotangent(hull, k, a, b)
            if cotangent > angle:
                c, angle = k, cotangent
        if angle <= 0.0:
            u, v = 0.5 * (hull[a, 0] + hull[b, 0]), 0.5 * (hull[a, 1] + hull[b, 1])
            return u, v, 0.5 * math.hypot(hull[a, 0] - hull[b, 0], hull[a, 1] - hull[b, 1])
        if _cotangent(hull, a, b, c) < 0.0:
            a = c
        elif _cotangent(hull, b, a, c) < 0.0:
            b = c
        else:
            return _circumcircle(hull, a, b, c)


@njit
def _cotangent(hull, at, a, b):
    """Cotangent of the angle at corner `at` between a and b: falls from +inf at 0 to -inf at 180 degrees."""
    ax, ay = hull[a, 0] - hull[at, 0], hull[a, 1] - hull[at, 1]
    bx, by = hull[b, 0] - hull[at, 0], hull[b, 1] - hull[at, 1]
    return (ax * bx + ay * by) / abs(ax * by - ay * bx)


@njit
def _circumcircle(hull, a, b, c):
    bx, by = hull[b, 0] - hull[a, 0], hull[b, 1] - hull[a, 1]
    cx, cy = hull[c, 0] - hull[a, 0], hull[c, 1] - hull[a, 1]
    double = 2.0 * (bx * cy - by * cx)
    bb, cc = bx * bx + by * by, cx * cx + cy * cy
    u, v = (cy * bb - by * cc) / double, (bx * cc - cx * bb) / double
    return hull[a, 0] + u, hull[a, 1] + v, math.hypot(u, v)


PAD = 4
"""Empty pixels around the picture that is opened: half of the largest kernel."""
EVENT, TESTED, SURVIVES = 1, 2, 4
"""Bits of a pixel while the picture is opened."""


class Settings(NamedTuple):
    """The thresholds of a config, in the units and with the names of its fields."""

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
    roi_expand_px: float


class Memory(NamedTuple):
    """Working arrays for windows of up to N events, made once."""

    picture: NDArray[np.uint8]
    """(height + 2 PAD, width + 2 PAD) see EVENT; 0 between windows."""
    kernel: NDArray[np.int64]
    """(K, 2) rows and columns of the opening's kernel around its middle."""
    clusters: ClusterMemory
    rows: NDArray[np.int64]
    """(2, N) numbers of the events in the region, and of those that survive the opening."""
    x_px: NDArray[np.int64]
    y_px: NDArray[np.int64]
    t_us: NDArray[np.int64]
    """Since the window's first event."""
    on: NDArray[np.bool_]
    """(N,) each: columns of the surviving events."""
    order: NDArray[np.int64]
    """(N,) numbers of the surviving events, cluster by cluster."""
    starts: NDArray[np.int64]
    """(N + 1,) where each cluster begins in `order`."""
    stamps: NDArray[np.int64]
    """(height, width) number of the cluster that has counted each pixel last; the last one given is `stamp[0]`."""
    stamp: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    """(height,) leftmost and rightmost pixel of a cluster in each row."""
    hull: NDArray[np.int64]
    """(2 height + 2, 2) corners."""


class Answer(NamedTuple):
    """Result of a window."""

    circles: int
    """Clusters that passed every test."""
    u_px: float
    v_px: float
    r_px: float
    """Radius of the chosen circle."""
    evidence: float
    """Evidence that ON is the leading polarity of the chosen cluster."""


@njit
def find_ball(events, centre_px, remembered, settings, memory):
    """The `Answer` for the columns (t_us, x_px, y_px, on) of one event or more.

    Searched is the region around a centre, on the whole sensor if that is not a number. `remembered` is the
    evidence of earlier windows that ON leads.
    """
    t_us, x_px, y_px, on = events
    count = _in_region(x_px, y_px, centre_px, settings.roi_expand_px, memory)
    count = _survivors(x_px, y_px, count, memory)
    for k in range(count):
        i = memory.rows[1, k]
        memory.x_px[k], memory.y_px[k], memory.t_us[k], memory.on[k] = x_px[i], y_px[i], t_us[i] - t_us[0], on[i]
    clusters = _cluster(count, settings.time_scale_px_per_ms, memory)
    answer, best = Answer(0, 0.0, 0.0, 0.0, 0.0), np.inf
    for cluster in range(clusters):
        size = memory.starts[cluster + 1] - memory.starts[cluster]
        if size < settings.size_min or size > settings.size_max:
            continue
        evidence = 0.0
        if settings.leading == 0:
            evidence = _on_evidence(cluster, clusters, settings.pair_radius_px, memory)
        leads = settings.leading > 0 or (settings.leading == 0 and remembered + evidence >= 0.0)
        circularity, u, v, r = _measure_edge(cluster, leads, settings, memory)
        if circularity < 0.0:
            continue
        badness = (u - centre_px[0]) ** 2 + (v - centre_px[1]) ** 2
        if math.isnan(badness):
            badness = -circularity
        # Of equals the first counts, as in the readable pipeline, whose sums round in another order.
        if badness < best - SAME_CIRCULARITY:
            best = badness
            answer = Answer(answer.circles + 1, u, v, r, evidence)
        else:
            answer = Answer(answer.circles + 1, answer.u_px, answer.v_px, answer.r_px, answer.evidence)
    return answer


@njit
def _in_region(x_px, y_px, centre_px, expand_px, memory):
    """Fill memory.rows[0] with the events in the region; returns how many they are."""
    u, v = centre_px
    whole, count = math.isnan(u), 0
    x_min, x_max, y_min, y_max = 0, 0, 0, 0
    if not whole:
        x_min, x_max = math.ceil(u - expand_px), math.floor(u + expand_px)
        y_min, y_max = math.ceil(v - expand_px), math.floor(v + expand_px)
    for i in range(len(x_px)):
        if whole or ((x_min <= x_px[i]) & (x_px[i] <= x_max) & (y_min <= y_px[i]) & (y_px[i] <= y_max)):
            memory.rows[0, count] = i
            count += 1
    return count


@njit
def _survivors(x_px, y_px, count, memory):
    """Open the binary image of memory.rows[0], fill memory.rows[1] with the events on it; returns how many they are."""
    picture, kernel = memory.picture, memory.kernel
    for i in memory.rows[0, :count]:
        picture[y_px[i] + PAD, x_px[i] + PAD] = EVENT
    for i in memory.rows[0, :count]:
        y, x = np.int64(y_px[i]) + PAD, np.int64(x_px[i]) + PAD
        if picture[y, x] & TESTED:
            continue
        picture[y, x] |= TESTED
        # An opening is the union of all kernels that fit, and a kernel fits only round a set pixel: the others need
        # no test.
        whole = True
        for k in range(len(kernel)):
            if not picture[y + kernel[k, 0], x + kernel[k, 1]]:
                whole = False
                break
        if whole:
            for k in range(len(kernel)):
                picture[y + kernel[k, 0], x + kernel[k, 1]] |= SURVIVES
    survivors = 0
    for i in memory.rows[0, :count]:
        if picture[y_px[i] + PAD, x_px[i] + PAD] & SURVIVES:
            memory.rows[1, survivors] = i
            survivors += 1
    for i in memory.rows[0, :count]:
        picture[y_px[i] + PAD, x_px[i] + PAD] = 0
    return survivors


@njit
def _cluster(count, time_scale_px_per_ms, memory):
    """Cluster the surviving events and sort them into memory.order; returns the number of clusters."""
    times = np.zeros(0)
    if time_scale_px_per_ms > 0.0:
        times = (memory.t_us[:count] - memory.t_us[0]) * (time_scale_px_per_ms / 1000.0)
    clusters = label_events(memory.x_px[:count], memory.y_px[:count], times, memory.clusters)
    labels, starts = memory.clusters.labels, memory.starts
    starts[: clusters + 1] = 0
    for k in range(count):
        if labels[k] >= 0:
            starts[labels[k] + 1] += 1
    for cluster in range(clusters):
        starts[cluster + 1] += starts[cluster]
    place = starts[:clusters].copy()
    for k in range(count):
        if labels[k] >= 0:
            memory.order[place[labels[k]]] = k
            place[labels[k]] += 1
    return clusters


@njit
def _on_evidence(cluster, clusters, radius_px, memory):
    """`stages.polarity.on_evidence` of all clustered events within a radius of a cluster's centroid."""
    x_px, y_px = memory.x_px, memory.y_px
    start, end = memory.starts[cluster], memory.starts[cluster + 1]
    sum_x, sum_y = 0, 0
    for k in memory.order[start:end]:
        sum_x += x_px[k]
        sum_y += y_px[k]
    centre_x, centre_y = sum_x / (end - start), sum_y / (end - start)
    origin_x, origin_y = np.int64(centre_x), np.int64(centre_y)  # whole numbers near 0 have exact sums
    sums = np.zeros((2, 10))
    for k in memory.order[: memory.starts[clusters]]:
        if (x_px[k] - centre_x) ** 2 + (y_px[k] - centre_y) ** 2 <= radius_px * radius_px:
            x, y, t = x_px[k] - origin_x, y_px[k] - origin_y, memory.t_us[k]
            side = sums[1 if memory.on[k] else 0]
            for number, value in enumerate((1, t, x, y, t * t, t * x, t * y, x * x, x * y, y * y)):
                side[number] += value
    return _correlation(sums[0], sums[1])


@njit
def _correlation(off, on):
    """Correlation of time with position along the line between the polarities, times sqrt(N), from sums per side:
    N, t, x, y, tt, tx, ty, xx, xy, yy.
    """
    if off[0] < MIN_EVENTS or on[0] < MIN_EVENTS:
        return 0.0
    du, dv = on[2] / on[0] - off[2] / off[0], on[3] / on[0] - off[3] / off[0]
    tt, tq, qq = 0.0, 0.0, 0.0
    for sums in (off, on):
        n, t, x, y = sums[0], sums[1], sums[2], sums[3]
        tt += sums[4] - t * t / n
        tq += du * (sums[5] - t * x / n) + dv * (sums[6] - t * y / n)
        xx, xy, yy = sums[7] - x * x / n, sums[8] - x * y / n, sums[9] - y * y / n
        qq += du * du * xx + 2.0 * du * dv * xy + dv * dv * yy
    if min(tt, qq) <= MIN_SPREAD:
        return 0.0
    return math.sqrt(off[0] + on[0]) * tq / math.sqrt(tt * qq)


@njit
def _measure_edge(cluster, on_leads, settings, memory):
    """Circularity, u, v, r of the leading events of a cluster near their centroid; circularity -1 if it is no ball."""
    nothing = -1.0, 0.0, 0.0, 0.0
    x_px, y_px, on, first, last = memory.x_px, memory.y_px, memory.on, memory.first, memory.last
    members = memory.order[memory.starts[cluster] : memory.starts[cluster + 1]]
    count, sum_x, sum_y, y_min, y_max = 0, 0, 0, len(first), -1
    for k in members:
        y_min, y_max = min(y_min, y_px[k]), max(y_max, y_px[k])
        if on[k] == on_leads:
            count += 1
            sum_x += x_px[k]
            sum_y += y_px[k]
    if not count:
        return nothing
    # Rows of the whole cluster: those without leading events keep first > last, which the hull leaves out.
    centre_x, centre_y, pixels = sum_x / count, sum_y / count, 0
    first[y_min : y_max + 1], last[y_min : y_max + 1] = 1 << 30, -1
    # A new number instead of clearing the map in which pixels are counted once.
    memory.stamp[0] += 1
    for k in members:
        x, y = x_px[k], y_px[k]
        near = (x - centre_x) ** 2 + (y - centre_y) ** 2 <= settings.outlier_radius_px**2
        if near and on[k] == on_leads and memory.stamps[y, x] != memory.stamp[0]:
            memory.stamps[y, x] = memory.stamp[0]
            first[y], last[y] = min(first[y], x), max(last[y], x)
            pixels += 1
    if not pixels:
        return nothing
    corners = hull_of_rows(first, last, y_min, y_max, memory.hull)
    area, perimeter = area_and_perimeter(memory.hull, corners)
    circularity = 4.0 * np.pi * area / (perimeter * perimeter) if area > 0.0 else 0.0
    solidity = pixels / area if area > 0.0 else 0.0
    if circularity < settings.circularity_min or solidity < settings.solidity_min:
        return nothing
    u, v, r = circle_of_hull(memory.hull, corners)
    if r < settings.radius_min_px - TOLERANCE_PX or r > settings.radius_max_px + TOLERANCE_PX:
        return nothing
    return circularity, u, v, r
