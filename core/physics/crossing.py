"""Crossings of a short flight segment, known at both ends, with the relevant planes.

Between its ends a piece is the cubic through both positions and velocities: exact for gravity alone, and with air off
by nanometres over 10 ms. So a coarse simulation step finds the instant of an impact exactly.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics.contact import FLOOR_Z_M, HALF_LENGTH_M
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]

DOWN: Final = 0
"""The ball comes down to the table's plane."""
NET_PLANE: Final = 1
END_PLANE: Final = 2
"""Over an end line towards the table."""
FLOOR_PLANE: Final = 3
HIT_PLANE: Final = 4
"""Through the hitting plane towards -x."""
FACE: Final = 5
"""Onto the plane of the racket's face, from the front."""
TOP_OF_ARC: Final = 6
COUNT: Final = 7


@njit
def _cubic(p0: float, v0: float, p1: float, v1: float, h: float, t: float) -> float:
    s = t / h
    return (
        p0 * (1 + 2 * s) * (1 - s) ** 2
        + h * v0 * s * (1 - s) ** 2
        + p1 * s * s * (3 - 2 * s)
        - h * v1 * s * s * (1 - s)
    )


@njit
def _slope(p0: float, v0: float, p1: float, v1: float, h: float, t: float) -> float:
    s = t / h
    return 6 * s * (1 - s) * (p1 - p0) / h + v0 * (1 - s) * (1 - 3 * s) + v1 * s * (3 * s - 2)


@njit
def piece_at(a: Array, b: Array, h: float, t: float, out: Array) -> None:
    """State (9,) `t` seconds into a piece of `h` seconds between states `a` and `b`; spin is constant in flight.

    Args:
        a: (9,) state at the piece's start: position, velocity, spin.
        b: (9,) state at its end.
        h: duration of the piece, s.
        t: time since its start, s.
        out: (9,) output.
    """
    for k in range(3):
        out[k] = _cubic(a[k], a[3 + k], b[k], b[3 + k], h, t)
        out[3 + k] = _slope(a[k], a[3 + k], b[k], b[3 + k], h, t)
    out[6:9] = a[6:9]


@njit
def _plane_value(
    which: int, a: Array, b: Array, h: float, racket_a: Array, racket_b: Array, hit_x: float, t: float
) -> float:
    """The signed distance that falls through zero at a crossing of plane `which`."""
    if which == DOWN:
        return _cubic(a[2], a[5], b[2], b[5], h, t) - BALL_RADIUS_M
    if which == FLOOR_PLANE:
        return _cubic(a[2], a[5], b[2], b[5], h, t) - FLOOR_Z_M - BALL_RADIUS_M
    if which == TOP_OF_ARC:
        return _slope(a[2], a[5], b[2], b[5], h, t)
    if which == FACE:
        # Normals are interpolated linearly and brought to length 1: a mean of two unit vectors is shorter.
        value = -BALL_RADIUS_M
        length = 0.0
        for k in range(3):
            n = racket_a[6 + k] + (racket_b[6 + k] - racket_a[6 + k]) * t / h
            length += n * n
        for k in range(3):
            n = racket_a[6 + k] + (racket_b[6 + k] - racket_a[6 + k]) * t / h
            ball = _cubic(a[k], a[3 + k], b[k], b[3 + k], h, t)
            face = _cubic(racket_a[k], racket_a[3 + k], racket_b[k], racket_b[3 + k], h, t)
            value += (ball - face) * n / math.sqrt(length)
        return value
    x = _cubic(a[0], a[3], b[0], b[3], h, t)
    heading = 1.0 if a[3] > 0 else -1.0
    if which == NET_PLANE:
        return -heading * x
    if which == END_PLANE:
        return -heading * x - HALF_LENGTH_M
    return x - hit_x


@njit
def find_crossings(a: Array, b: Array, h: float, racket_a: Array, racket_b: Array, hit_x: float, times: Array) -> None:
    """Write to `times` (COUNT,) when in (0, h] each plane is crossed, NaN where it is not.

    `a`, `b` are ball states (9,); `racket_a`, `racket_b` hold position, velocity and normal of the face (9,).

    Args:
        a: (9,) ball state at the start of the step: position m, velocity m/s, spin rad/s.
        b: (9,) ball state at its end.
        h: duration of the step, s.
        racket_a: (9,) position, velocity and normal of the face at the start.
        racket_b: (9,) the same at the end.
        hit_x: x of the hitting plane, m.
        times: (COUNT,) output, s since the start.
    """
    for which in range(COUNT):
        times[which] = math.nan
        low, high = 0.0, h
        at_low = _plane_value(which, a, b, h, racket_a, racket_b, hit_x, low)
        at_high = _plane_value(which, a, b, h, racket_a, racket_b, hit_x, high)
        if which == DOWN and abs(at_low) < 1e-12 and a[5] > 0:
            # Just bounced: look for the next fall from the top of the hop on, not for the bounce itself.
            low = min(h, a[5] / GRAVITY_MPS2)
            at_low = _plane_value(which, a, b, h, racket_a, racket_b, hit_x, low)
        if not (at_low > 0 and at_high <= 0):
            continue
        for _ in range(60):
            middle = (low + high) / 2
            if _plane_value(which, a, b, h, racket_a, racket_b, hit_x, middle) > 0:
                low = middle
            else:
                high = middle
        times[which] = high
