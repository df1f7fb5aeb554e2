"""First contact of a flying ball: the table's top, its end, the net or the floor.

The rules, where the paper says only "first contact" (choices):
- The ball's lowest point decides. A ball is on the table if that point is over the top when it comes down to it; one
  that passes outside is not, although a real ball may still clip the edge within its radius.
- The net is a thin wall over x = 0 that stands 15.25 cm beyond the side lines, posts included. The ball touches it if
  it overlaps it at the instant at which its centre is over x = 0: a let cord is a touch, whatever would become of it.
- A ball that is below the top where it comes over an end line hits the table's end, down to the floor.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics.flight import MAX_FLIGHT_S, Air, fall_through, fly
from core.table import (
    BALL_RADIUS_M,
    GRAVITY_MPS2,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

Array = NDArray[np.float64]

NOTHING: Final = 0
OWN_TOP: Final = 1
NET: Final = 2
FLOOR: Final = 3
FAR_TOP: Final = 4
OWN_END: Final = 5
FAR_END: Final = 6

HALF_LENGTH_M: Final = TABLE_LENGTH_M / 2
HALF_WIDTH_M: Final = TABLE_WIDTH_M / 2
NET_HALF_WIDTH_M: Final = HALF_WIDTH_M + NET_OVERHANG_M
FLOOR_Z_M: Final = -TABLE_HEIGHT_M


@njit
def over_table(x: float, y: float) -> bool:
    """Whether a point is over the table's top, lines included."""
    return abs(x) <= HALF_LENGTH_M and abs(y) <= HALF_WIDTH_M


@njit
def overlaps_net(y: float, z: float) -> bool:
    """Whether a ball with its centre over x = 0 at (y, z) touches the net."""
    return abs(y) <= NET_HALF_WIDTH_M and -BALL_RADIUS_M < z < NET_HEIGHT_M + BALL_RADIUS_M


@njit
def come_down(s: Array, air: Air, out: Array) -> float:
    """When the ball comes down to the table's plane (centre one radius above it), or NaN; the state goes to `out`."""
    return fall_through(s, (0.0, 0.0, 1.0, 0.0, -BALL_RADIUS_M), air, out)


@njit
def cross_net_plane(s: Array, air: Air, out: Array) -> float:
    """When the ball's centre crosses x = 0 in the direction in which it moves, or NaN; the state goes to `out`."""
    heading = 1.0 if s[3] > 0 else -1.0
    return fall_through(s, (-heading, 0.0, 0.0, 0.0, 0.0), air, out)


@njit
def highest_point(s: Array, air: Air, out: Array) -> float:
    """When the ball is highest from now on (now, if it falls); the state goes to `out`."""
    out[:] = s
    if s[5] <= 0:
        return 0.0
    if not air.acts:
        t = s[5] / GRAVITY_MPS2
        fly(s, t, air, out)
        return t
    t = 0.0
    while t < MAX_FLIGHT_S:
        before = out[5]
        fly(out, air.step_s, air, out)
        t += air.step_s
        if out[5] <= 0:
            # The climb rate is nearly linear within a step: two Newton steps from its end give nanometres.
            fall = (before - out[5]) / air.step_s
            for _ in range(2):
                back = out[5] / fall
                fly(out, back, air, out)
                t += back
            return t
    return t


@njit
def next_contact(s: Array, air: Air, out: Array) -> tuple[int, float]:
    """What the ball touches first and when; its state at that time, before the impact, goes to `out`."""
    touched, first = NOTHING, math.inf
    state = np.empty(9)
    # A ball meets the net and a table's end only on the side from which it comes.
    heading = 1.0 if s[3] > 0 else -1.0

    t = come_down(s, air, state)
    if t < first and over_table(state[0], state[1]):
        touched, first = (OWN_TOP if state[0] < 0 else FAR_TOP), t
        out[:] = state
    if heading * s[0] < 0:
        t = cross_net_plane(s, air, state)
        if t < first and overlaps_net(state[1], state[2]):
            touched, first = NET, t
            out[:] = state
    if heading * s[0] < -HALF_LENGTH_M:
        t = fall_through(s, (-heading, 0.0, 0.0, 0.0, -HALF_LENGTH_M), air, state)
        below_top = FLOOR_Z_M + BALL_RADIUS_M < state[2] < BALL_RADIUS_M
        if t < first and below_top and abs(state[1]) <= HALF_WIDTH_M:
            touched, first = (OWN_END if state[0] < 0 else FAR_END), t
            out[:] = state
    # A contact below the floor cannot be: the ball was on the floor before.
    if touched == NOTHING or out[2] < FLOOR_Z_M + BALL_RADIUS_M:
        t = fall_through(s, (0.0, 0.0, 1.0, 0.0, -FLOOR_Z_M - BALL_RADIUS_M), air, state)
        if t < first:
            touched, first = FLOOR, t
            out[:] = state
    return touched, first
