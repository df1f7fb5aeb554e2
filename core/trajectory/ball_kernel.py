"""A ball with drag, spin and a table that turns spin into speed: one step, and the touches that are to come.

A state is (12,): position, velocity, spin, drag coefficient, restitution and friction of the table. The last three are
constants of air and table that are not known exactly; having them in the state lets a filter carry that.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.table import BALL_MASS_KG, BALL_RADIUS_M, GRAVITY_MPS2, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

STATE: Final = 12
AIR_KG_PER_M3: Final = 1.204
DRAG_PER_M: Final = 0.5 * AIR_KG_PER_M3 * math.pi * BALL_RADIUS_M**2 / BALL_MASS_KG
"""Times the drag coefficient."""
LIFT: Final = AIR_KG_PER_M3 * 4 / 3 * math.pi * BALL_RADIUS_M**3 / BALL_MASS_KG
"""Times the Magnus coefficient: acceleration over (spin x velocity)."""
STEP_S: Final = 0.005
ROLLING: Final = 0.4
"""Tangential impulse per mass that stops the contact point of a thin shell, over its speed."""
FAR_STEP_S: Final = 0.010
"""Of what is to come: still exact to a micrometre."""
LONGEST_S: Final = 2.0
BOUNCES: Final = 2
TOUCHES: Final = 19
"""What `touches` writes: two bounces and the landing as (t, x, y, z), the hitting plane as (t, p, v)."""


@njit(cache=True, nogil=True, inline="always")
def _pull(vx: float, vy: float, vz: float, s: Array, lift: float) -> tuple[float, float, float]:
    k = DRAG_PER_M * s[9] * math.sqrt(vx * vx + vy * vy + vz * vz)
    return (
        -k * vx + lift * (s[7] * vz - s[8] * vy),
        -k * vy + lift * (s[8] * vx - s[6] * vz),
        -k * vz + lift * (s[6] * vy - s[7] * vx) - GRAVITY_MPS2,
    )


@njit(cache=True, nogil=True)
def glide(s: Array, h: float, lift: float, out: Array) -> None:
    """One Runge-Kutta step of free flight from `s` to `out`, which may be `s`."""
    vx, vy, vz = s[3], s[4], s[5]
    ax, ay, az = _pull(vx, vy, vz, s, lift)
    bx, by, bz = _pull(vx + h / 2 * ax, vy + h / 2 * ay, vz + h / 2 * az, s, lift)
    cx, cy, cz = _pull(vx + h / 2 * bx, vy + h / 2 * by, vz + h / 2 * bz, s, lift)
    dx, dy, dz = _pull(vx + h * cx, vy + h * cy, vz + h * cz, s, lift)
    out[0] = s[0] + h * (vx + h / 6 * (ax + bx + cx))
    out[1] = s[1] + h * (vy + h / 6 * (ay + by + cy))
    out[2] = s[2] + h * (vz + h / 6 * (az + bz + cz))
    out[3] = vx + h / 6 * (ax + 2 * bx + 2 * cx + dx)
    out[4] = vy + h / 6 * (ay + 2 * by + 2 * cy + dy)
    out[5] = vz + h / 6 * (az + 2 * bz + 2 * cz + dz)
    out[6:] = s[6:]


@njit(cache=True, nogil=True)
def bounce(s: Array) -> None:
    """Change velocity and spin as the table does: restitution upwards, Coulomb friction at the contact point."""
    push = -(1 + s[10]) * s[5]
    ux, uy = s[3] - BALL_RADIUS_M * s[7], s[4] + BALL_RADIUS_M * s[6]
    slip = math.hypot(ux, uy)
    share = min(ROLLING, s[11] * push / slip) if slip > 0 else 0.0
    s[3] -= share * ux
    s[4] -= share * uy
    s[5] += push
    s[6] -= 1.5 / BALL_RADIUS_M * share * uy
    s[7] += 1.5 / BALL_RADIUS_M * share * ux


@njit(cache=True, nogil=True, inline="always")
def _over_table(s: Array) -> bool:
    return abs(s[0]) <= TABLE_LENGTH_M / 2 and abs(s[1]) <= TABLE_WIDTH_M / 2


@njit(cache=True, nogil=True)
def _reach(s: Array, axis: int, place: float, h: float, after: Array, lift: float, out: Array) -> float:
    """When within a step `h` from `s` to `after` the ball is at a place along an axis; the state goes to `out`."""
    gap = s[axis] - place
    t = h * gap / (gap - (after[axis] - place)) if after[axis] != s[axis] else 0.0
    for _ in range(4):
        glide(s, t, lift, out)
        if abs(out[3 + axis]) > 1e-9:
            t = min(max(t - (out[axis] - place) / out[3 + axis], 0.0), h)
    glide(s, t, lift, out)
    return t


@njit(cache=True, nogil=True)
def advance(s: Array, seconds: float, lift: float) -> float:
    """Move `s` on, off the table where it comes down on it; how long ago the last bounce was, -1 if there was none."""
    after, down = np.empty(STATE), np.empty(STATE)
    left, since = seconds, -1.0
    while left > 1e-12:
        h = min(left, STEP_S)
        glide(s, h, lift, after)
        if s[2] >= BALL_RADIUS_M > after[2]:
            h = _reach(s, 2, BALL_RADIUS_M, h, after, lift, down)
            after[:] = down
            if _over_table(after) and after[5] < 0:
                after[2] = BALL_RADIUS_M
                bounce(after)
                since = left - h
            else:
                after[2] = BALL_RADIUS_M - 1e-12
        s[:] = after
        left -= h
    return since


@njit(cache=True, nogil=True)
def touches(states: Array, t_s: float, hit_x_m: float, lift: float, found: Array) -> None:
    """Write to `found` (N, 19) what each state (N, 12) at time t_s touches next; nan where it does not."""
    s, after, there = np.empty(STATE), np.empty(STATE), np.empty(STATE)
    found[:] = np.nan
    for row in range(len(states)):
        s[:] = states[row]
        t, bounced = 0.0, 0
        while t < LONGEST_S and s[2] > -TABLE_HEIGHT_M:
            h = FAR_STEP_S
            glide(s, h, lift, after)
            lands = s[2] >= BALL_RADIUS_M > after[2]
            if lands:
                h = _reach(s, 2, BALL_RADIUS_M, h, after, lift, there)
                after[:] = there
            if s[0] >= hit_x_m > after[0] and math.isnan(found[row, 12]):
                found[row, 12] = t_s + t + _reach(s, 0, hit_x_m, h, after, lift, there)
                found[row, 13:19] = there[:6]
                found[row, 13] = hit_x_m
            t += h
            if lands:
                on_table = bounced < BOUNCES and _over_table(after) and after[5] < 0
                if math.isnan(found[row, 8]):
                    found[row, 8] = t_s + t
                    found[row, 9:12] = after[:3]
                after[2] = BALL_RADIUS_M - 1e-12
                if on_table:
                    after[2] = BALL_RADIUS_M
                    found[row, 4 * bounced] = t_s + t
                    found[row, 4 * bounced + 1 : 4 * bounced + 4] = after[:3]
                    bounce(after)
                    bounced += 1
            s[:] = after
            if not math.isnan(found[row, 12]) and not math.isnan(found[row, 8]):
                break


@njit(cache=True, nogil=True)
def places(states: Array, t_s: float, times_s: Array, lift: float, ps_m: Array) -> None:
    """Write to `ps_m` (N, K, 3) where each state (N, 12) at t_s is at ascending times (K,); earlier ones are at t_s."""
    s = np.empty(STATE)
    for row in range(len(states)):
        s[:] = states[row]
        now = t_s
        for k in range(len(times_s)):
            advance(s, times_s[k] - now, lift)
            now = max(now, times_s[k])
            ps_m[row, k] = s[:3]


@njit(cache=True, nogil=True)
def predict_step(x: Array, cov: Array, seconds: float, lift: float, noise: Array) -> float:
    """Move the estimate on, in place, with its covariance; Jacobian by differences. What `advance` returns."""
    F, moved = np.empty((STATE, STATE)), np.empty(STATE)
    nominal = x.copy()
    since = advance(nominal, seconds, lift)
    for k in range(STATE):
        eps = 1e-4 if k in (6, 7, 8) else 1e-7
        moved[:] = x
        moved[k] += eps
        advance(moved, seconds, lift)
        F[:, k] = (moved - nominal) / eps
    cov[:] = F @ cov @ F.T
    for k in range(3):
        # White acceleration: what the model of the air leaves out.
        q = noise[0] ** 2 * seconds
        cov[3 + k, 3 + k] += q
        cov[k, 3 + k] += q * seconds / 2
        cov[3 + k, k] += q * seconds / 2
        cov[k, k] += q * seconds * seconds / 3
        if since >= 0:
            # Scatter from bounce to bounce, along the table and upwards.
            cov[3 + k, 3 + k] += noise[1] ** 2
    x[:] = nominal
    return since


@njit(cache=True, nogil=True)
def observe(x: Array, cov: Array, p_m: Array, sigma_m: float, gate: float) -> float:
    """Take an observed position into the estimate unless it is too far off; its squared normalised distance."""
    new, new_cov = x.copy(), cov.copy()
    total = 0.0
    for axis in range(3):
        variance = new_cov[axis, axis] + sigma_m**2
        miss = p_m[axis] - new[axis]
        total += miss * miss / variance
        gain = new_cov[:, axis].copy() / variance
        new += gain * miss
        new_cov -= np.outer(gain, new_cov[axis].copy())
    if total <= gate:
        x[:] = new
        cov[:] = 0.5 * (new_cov + new_cov.T)
    return total
