"""A ball with drag, spin and a table that turns spin into speed: one step of its flight, and what it touches next.

A state is (14,): position, velocity, spin, drag coefficient, restitution and friction of the table, how much higher the
table is than it should be, and how far ahead of the ball its observations are. The last five are constants that are
not known exactly; having them in the state lets a filter carry that.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics.contact import over_table
from core.physics.flight import acceleration, rk4_step
from core.physics.impact import Surface, strike
from core.table import AIR_KG_PER_M3, BALL_MASS_KG, BALL_RADIUS_M, TABLE_HEIGHT_M

Array = NDArray[np.float64]

STATE: Final = 14
SPIN, DRAG, RESTITUTION, FRICTION, HIGHER, AHEAD = 6, 9, 10, 11, 12, 13
"""Indices in the state, after position and velocity."""
DRAG_PER_M: Final = 0.5 * AIR_KG_PER_M3 * math.pi * BALL_RADIUS_M**2 / BALL_MASS_KG
"""Deceleration factor per drag coefficient, 1/m."""
LIFT: Final = AIR_KG_PER_M3 * 4 / 3 * math.pi * BALL_RADIUS_M**3 / BALL_MASS_KG
"""Times the Magnus coefficient: acceleration over (spin x velocity)."""
STEP_S: Final = 0.040
"""Step of a flight: the fourth-order step is exact to 1 um at 10 m/s and 300 rad/s."""
SLOWEST_MPS: Final = 0.05
"""A ball that comes down more slowly does not bounce any more (avoids endless bounces)."""
LONGEST_S: Final = 2.0
"""Flights are followed for so long. Chosen by hand; not measured."""
BOUNCES: Final = 2
"""Bounces that are followed, and written by `touches`: at the second one the rally is over."""
TOUCHES: Final = 22
"""What `touches` writes: two bounces and the landing as (t, x, y, z), the hitting plane as (t, p, v, spin)."""


@njit(inline="always")
def pull(s: Array, lift: float) -> tuple[float, float, float]:
    """The acceleration of a ball of state `s`."""
    return acceleration(s[3], s[4], s[5], s, DRAG_PER_M * s[DRAG], lift)


@njit
def glide(s: Array, h: float, lift: float, out: Array) -> None:
    """One Runge-Kutta step of free flight from `s` to `out`, which may be `s`.

    Args:
        s: (14,) state.
        h: step, s.
        lift: acceleration per spin and velocity across it.
        out: (14,) output.
    """
    rk4_step(s, h, DRAG_PER_M * s[DRAG], lift, out)
    for k in range(SPIN, STATE):
        out[k] = s[k]


@njit
def bounce(s: Array) -> None:
    """Change velocity and spin as the table does: restitution upwards, Coulomb friction at the contact point."""
    strike(s, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), Surface(s[RESTITUTION], 0.0, 0.0, 0.0, s[FRICTION], 1.0))


@njit
def down_in(s: Array, lift: float) -> float:
    """Time until the ball reaches the table's plane at its present acceleration; -1 if it is below it."""
    gap = s[2] - BALL_RADIUS_M - s[12]
    if gap < 0:
        return -1.0
    fall = -pull(s, lift)[2]
    root = s[5] * s[5] + 2 * fall * gap
    return (s[5] + math.sqrt(root)) / fall if fall > 0 and root >= 0 else math.inf


@njit
def land(s: Array, h: float, guess_s: float, lift: float, out: Array) -> float:
    """When within `h` the ball is down at the table's plane; the state goes to `out`.

    Args:
        s: (14,) state before the landing.
        h: time within which it comes, s.
        guess_s: first guess of when, s.
        lift: acceleration per spin and velocity across it.
        out: (14,) output.
    """
    t = min(max(guess_s, 0.0), h)
    # Newton's method on the height, which is nearly a parabola: three steps end at the rounding.
    for _ in range(3):
        glide(s, t, lift, out)
        if out[5] < -1e-9:
            t = min(max(t - (out[2] - BALL_RADIUS_M - s[12]) / out[5], 0.0), h)
    glide(s, t, lift, out)
    return t


@njit
def _meet(s: Array, x_m: float, h: float, lift: float, out: Array) -> float:
    """When within `h` the ball crosses x; the state goes to `out`."""
    t = 0.0
    glide(s, t, lift, out)
    for _ in range(3):
        if abs(out[3]) > 1e-9:
            t = min(max(t - (out[0] - x_m) / out[3], 0.0), h)
        glide(s, t, lift, out)
    return t


@njit
def fly_and_bounce(s: Array, seconds: float, lift: float) -> None:
    """Move `s` (14,) on by `seconds`, off the table where it comes down on it; `lift` as in `glide`."""
    after, there = np.empty(STATE), np.empty(STATE)
    left = seconds
    while left > 1e-12:
        h = min(left, STEP_S)
        down = down_in(s, lift)
        glide(s, h, lift, after)
        if down >= 0 and after[2] < BALL_RADIUS_M + s[12]:
            h = land(s, h, down, lift, there)
            after[:] = there
            if over_table(after[0], after[1]) and after[5] < -SLOWEST_MPS:
                after[2] = BALL_RADIUS_M + s[12]
                bounce(after)
            else:
                # Just below the plane, or the next step would find the same landing again.
                after[2] = BALL_RADIUS_M + s[12] - 1e-12
        s[:] = after
        left -= h


@njit
def touches(states: Array, t_s: float, hit_x_m: float, lift: float, found: Array) -> None:
    """Write to `found` (N, 22) what each state (N, 14) at time t_s touches next; nan where it does not.

    Args:
        states: (N, 14).
        t_s: their common time.
        hit_x_m: x of the hitting plane.
        lift: acceleration per spin and velocity across it.
        found: (N, 22) output.
    """
    s, after, there = np.empty(STATE), np.empty(STATE), np.empty(STATE)
    found[:] = np.nan
    for row in range(len(states)):
        s[:] = states[row]
        t, bounced = 0.0, 0
        while t < LONGEST_S and s[2] > -TABLE_HEIGHT_M:
            h = STEP_S
            top = BALL_RADIUS_M + s[12]
            down = down_in(s, lift)
            glide(s, h, lift, after)
            lands = down >= 0 and after[2] < top
            if lands:
                h = land(s, h, down, lift, there)
                after[:] = there
            if s[0] >= hit_x_m > after[0] and math.isnan(found[row, 12]):
                found[row, 12] = t_s + t + _meet(s, hit_x_m, h, lift, there)
                found[row, 13:22] = there[:9]
                # Where it is by definition, without the error of the search.
                found[row, 13] = hit_x_m
            t += h
            if lands:
                if math.isnan(found[row, 8]):
                    found[row, 8] = t_s + t
                    found[row, 9:12] = after[:3]
                if bounced < BOUNCES and over_table(after[0], after[1]) and after[5] < 0:
                    after[2] = top
                    found[row, 4 * bounced] = t_s + t
                    found[row, 4 * bounced + 1 : 4 * bounced + 4] = after[:3]
                    bounce(after)
                    bounced += 1
                else:
                    # Just below the plane, or the next step would find the same landing again.
                    after[2] = top - 1e-12
            s[:] = after
            if not math.isnan(found[row, 12]) and not math.isnan(found[row, 8]):
                break


@njit
def crossings(states: Array, t_s: float, xs_m: Array, lift: float, found: Array) -> None:
    """Write to `found` (N, K, 10) when, and in which state, each of N balls first crosses K planes towards the robot.

    A plane that a ball does not reach within `LONGEST_S`, or above the floor, has nan.

    Args:
        states: (N, 14).
        t_s: their common time.
        xs_m: (K,) x of the planes, descending.
        lift: acceleration per spin and velocity across it.
        found: (N, K, 10) output: t, then position, velocity and spin.
    """
    s, after, there = np.empty(STATE), np.empty(STATE), np.empty(STATE)
    found[:] = np.nan
    for row in range(len(states)):
        s[:] = states[row]
        t, bounced, k = 0.0, 0, 0
        while k < len(xs_m) and s[0] < xs_m[k]:  # behind it already
            k += 1
        while t < LONGEST_S and s[2] > -TABLE_HEIGHT_M and k < len(xs_m):
            h = STEP_S
            top = BALL_RADIUS_M + s[12]
            down = down_in(s, lift)
            glide(s, h, lift, after)
            lands = down >= 0 and after[2] < top
            if lands:
                h = land(s, h, down, lift, there)
                after[:] = there
            while k < len(xs_m) and s[0] >= xs_m[k] > after[0]:
                found[row, k, 0] = t_s + t + _meet(s, xs_m[k], h, lift, there)
                found[row, k, 1:] = there[:9]
                found[row, k, 1] = xs_m[k]
                k += 1
            t += h
            if lands:
                if bounced < BOUNCES and over_table(after[0], after[1]) and after[5] < 0:
                    after[2] = top
                    bounce(after)
                    bounced += 1
                else:
                    after[2] = top - 1e-12
            s[:] = after


@njit
def places(states: Array, t_s: float, times_s: Array, lift: float, ps_m: Array) -> None:
    """Write to `ps_m` (N, K, 3) where each state (N, 14) at t_s is at ascending times (K,); earlier ones are at t_s.

    Args:
        states: (N, 14).
        t_s: their common time.
        times_s: (K,) ascending.
        lift: acceleration per spin and velocity across it.
        ps_m: (N, K, 3) output.
    """
    s = np.empty(STATE)
    for row in range(len(states)):
        s[:] = states[row]
        now = t_s
        for k in range(len(times_s)):
            fly_and_bounce(s, times_s[k] - now, lift)
            now = max(now, times_s[k])
            ps_m[row, k] = s[:3]
