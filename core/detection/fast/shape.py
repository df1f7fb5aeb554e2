"""Hull, circularity, solidity and minimum enclosing circle of a set of pixels, from its leftmost and rightmost ones."""

from __future__ import annotations

import math

import numpy as np

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
