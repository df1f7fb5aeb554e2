"""What the kernels need to know of a block: its substeps, with ball and racket at each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from core.jit import njit
from core.simulation.scenes.flicker import FlickerSwing
from core.simulation.scenes.racket_shape import RACKET_COLUMNS
from core.simulation.scenes.shading import BALL_COLUMNS, Moving

Array = NDArray[np.float64]

BALL, SHADOW, RACKET = range(3)
"""Parts of the picture that move, in the order in which they are looked at."""


class Steps(NamedTuple):
    """Ball and racket at S + 1 instants, equally spaced, to one camera."""

    t_us: Array
    """(S + 1,)."""
    rows: Array
    """(S + 1, BALL_COLUMNS), see `core.simulation.scenes.shading`."""
    rackets: Array
    """(S + 1, RACKET_COLUMNS), see `core.simulation.scenes.racket_shape`."""
    outlines: Array
    """(S + 1, K, 2) pixels of points on the racket's rims, see `core.simulation.scenes.racket_outline`."""
    boxes: NDArray[np.int64]
    """(S + 1, 3, 4): first column, first row, one past the last column and row of ball, shadow and racket; empty where
    0."""
    swing: FlickerSwing
    strides: NDArray[np.int64]
    """(3,): substeps from one look at ball, shadow and racket to the next, 0 for no look: a soft shadow changes slowly,
    a racket at rest not at all."""


@njit(error_model="numpy")
def moving_at(steps, step, see_ball, see_shadow, see_racket):
    """Ball and racket at a substep."""
    ball = to_fixed_tuple(steps.rows[step], BALL_COLUMNS)  # pyright: ignore[reportCallIssue] - a numba intrinsic
    racket = to_fixed_tuple(steps.rackets[step], RACKET_COLUMNS)  # pyright: ignore[reportCallIssue]
    return Moving(ball, racket, see_ball, see_shadow, see_racket)


@njit(error_model="numpy")
def is_looked_at(steps, step, part):
    """Whether a part is looked at in this substep."""
    stride = steps.strides[part]
    return stride != 0 and (step % stride == 0 or step == len(steps.t_us) - 1)


@njit(error_model="numpy")
def union_box(a, b):
    """The box round two boxes (first column, first row, last + 1 ...); an empty one does not count."""
    if a[2] <= a[0]:
        return b[0], b[1], b[2], b[3]
    if b[2] <= b[0]:
        return a[0], a[1], a[2], a[3]
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


@njit(error_model="numpy")
def boxes_meet(a, b):
    """Whether two boxes have a pixel in common."""
    return max(a[0], b[0]) < min(a[2], b[2]) and max(a[1], b[1]) < min(a[3], b[3])
