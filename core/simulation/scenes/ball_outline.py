"""The ball's rim in the picture, row by row: a look at the ball touches only pixels that may have changed.

A pixel sees the ball where its ray lies in a cone round the ball's centre. Along a row of the picture rays lie nearly
on a straight line, so where the row enters and leaves the cone is found in closed form. That is a little rough, and
only says where to look; what a pixel sees there is computed from the body itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from core.jit import njit
from core.simulation.scenes.background import RAY_X, RAY_Y

MARGIN_PX = 1.5
"""Beside twice the bend of a row."""


class Cone(NamedTuple):
    """All rays that pass a point at less than some distance."""

    x: float
    y: float
    z: float
    """The point in the camera's frame."""
    tangent2: float
    """Squared length of a tangent to the sphere of that radius; infinite for no ray, 0 for all."""


class Rim(NamedTuple):
    """What may have changed between two looks at the ball."""

    before: Cone
    now: Cone
    inner: Cone
    """No ray outside of both changed; none in this has to be looked at."""


NO_RAY = Cone(0.0, 0.0, 0.0, math.inf)
NO_RIM = Rim(NO_RAY, NO_RAY, NO_RAY)


@njit(error_model="numpy")
def ball_rim_between(maps, width, box, before, now, skip_deep):
    """The rim between two rows of BALL_COLUMNS for a box of the picture: columns [box[0], box[2]), rows likewise."""
    middle, last = (box[0] + box[2]) // 2, box[2] - 1
    row = (box[1] + box[3]) // 2 * width
    each = bend = 0.0
    for axis in (RAY_X, RAY_Y):
        a, m, b = maps[row + box[0], axis], maps[row + middle, axis], maps[row + last, axis]
        share = (middle - box[0]) / max(last - box[0], 1)
        bend = max(bend, abs(m - a - share * (b - a)))
        each = max(each, abs(b - a) / max(last - box[0], 1))
    margin = MARGIN_PX * each + 2.0 * bend
    inner = NO_RAY
    if skip_deep and now[16] < math.inf:
        inner = _cone(now, now[16], -margin)
    return Rim(_cone(before, before[15], margin), _cone(now, now[15], margin), inner)


@njit(error_model="numpy")
def _cone(ball, tangent2, margin):
    """The cone of a sphere round the ball, wider by a margin per metre of camera z."""
    x, y, z = ball[0], ball[1], ball[2]
    distance2 = x * x + y * y + z * z
    reach = math.sqrt(max(distance2 - tangent2, 0.0)) + margin * z
    if z <= 0.0 or reach <= 0.0:
        return Cone(x, y, z, math.inf)
    return Cone(x, y, z, max(distance2 - reach * reach, 0.0))


@njit(error_model="numpy")
def rim_columns(maps, row, x0, x1, rim):
    """(first, left, right, end): of columns [x0, x1) only [first, left) and [right, end) may have changed.

    `row` is the number of the row's first pixel.
    """
    n = x1 - 1 - x0
    if n < 1:
        return x0, x1, x1, x1
    x, y = float(maps[row + x0, RAY_X]), float(maps[row + x0, RAY_Y])
    line = x, y, (maps[row + x1 - 1, RAY_X] - x) / n, (maps[row + x1 - 1, RAY_Y] - y) / n
    a, b = _within(rim.before, line, n)
    c, d = _within(rim.now, line, n)
    low, high = min(a, c), max(b, d)
    if low > high:
        return x0, x0, x0, x0
    first, end = x0 + max(math.floor(low), 0), x0 + min(math.ceil(high), n) + 1
    low, high = _within(rim.inner, line, n)
    if low > high:
        return first, end, end, end
    left, right = x0 + math.ceil(low), x0 + math.floor(high) + 1
    return (first, end, end, end) if right <= left else (first, max(left, first), min(right, end), end)


@njit(error_model="numpy")
def _within(cone, line, n):
    """Between which places 0 ... n of a line of rays (first x and y, and their steps) they are in a cone."""
    x, y, dx, dy = line
    if cone.tangent2 == math.inf:
        return math.inf, -math.inf
    p, q = x * cone.x + y * cone.y + cone.z, dx * cone.x + dy * cone.y
    # (p + q i)^2 > tangent2 |ray|^2, as a i^2 + 2 b i + c > 0.
    a = q * q - cone.tangent2 * (dx * dx + dy * dy)
    b = p * q - cone.tangent2 * (x * dx + y * dy)
    c = p * p - cone.tangent2 * (x * x + y * y + 1.0)
    if a >= 0.0:  # so near that its outline is no ellipse
        return 0.0, float(n)
    root2 = b * b - a * c
    if root2 < 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root2)
    low, high = (-b + root) / a, (-b - root) / a
    return (max(low, 0.0), min(high, float(n))) if low <= n and high >= 0.0 else (math.inf, -math.inf)
