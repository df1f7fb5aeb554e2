"""Free flight: the state of the ball some time later, and when it first falls through a plane.

A state is (9,): position, velocity, spin in the world. Gravity alone is solved in closed form; with air the flight is
integrated with fixed Runge-Kutta steps and the crossing is located inside the step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics.config import PhysicsConfig
from core.table import BALL_MASS_KG, BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]

MAX_FLIGHT_S = 3.0
"""No ball of this task is in the air for longer (3 s of free fall are 44 m)."""


class Air(NamedTuple):
    """Accelerations of the flight as the kernels take them: -drag |v| v + lift (spin x v) - gravity."""

    drag_per_m: float
    lift: float
    step_s: float
    acts: bool


def air_from_config(physics: PhysicsConfig) -> Air:
    """The kernel's constants from the config's coefficients."""
    area = math.pi * BALL_RADIUS_M**2
    volume = 4 / 3 * math.pi * BALL_RADIUS_M**3
    rho = physics.air.density_kg_per_m3
    return Air(
        drag_per_m=0.5 * rho * physics.air.drag_coefficient * area / BALL_MASS_KG,
        lift=rho * physics.air.magnus_coefficient * volume / BALL_MASS_KG,
        step_s=physics.flight_step_s,
        acts=physics.has_air,
    )


@njit(inline="always")
def acceleration(
    vx: float, vy: float, vz: float, s: Array, drag_per_m: float, lift: float
) -> tuple[float, float, float]:
    """Acceleration by air and gravity of a ball with the spin of state `s`, at another velocity.

    Args:
        vx: velocity of the ball along x in still air, m/s.
        vy: along y, m/s.
        vz: along z, m/s.
        s: state with the spin at 6 to 8, rad/s.
        drag_per_m: rho C_d A / 2m, 1/m.
        lift: rho C_m A r / 2m: acceleration per spin and velocity across it.
    """
    k = drag_per_m * math.sqrt(vx * vx + vy * vy + vz * vz)
    return (
        -k * vx + lift * (s[7] * vz - s[8] * vy),
        -k * vy + lift * (s[8] * vx - s[6] * vz),
        -k * vz + lift * (s[6] * vy - s[7] * vx) - GRAVITY_MPS2,
    )


@njit(inline="always")
def rk4_step(s: Array, h: float, drag_per_m: float, lift: float, out: Array) -> None:
    """Write position and velocity one Runge-Kutta step after `s` to the first six of `out`, which may be `s`.

    The filter's states, which are longer, fly by the same step as the simulation's.

    Args:
        s: state, at least (9,): position, velocity, spin.
        h: step, s.
        drag_per_m: rho C_d A / 2m, 1/m.
        lift: rho C_m A r / 2m.
        out: output, at least (6,).
    """
    vx, vy, vz = s[3], s[4], s[5]
    ax, ay, az = acceleration(vx, vy, vz, s, drag_per_m, lift)
    bx, by, bz = acceleration(vx + h / 2 * ax, vy + h / 2 * ay, vz + h / 2 * az, s, drag_per_m, lift)
    cx, cy, cz = acceleration(vx + h / 2 * bx, vy + h / 2 * by, vz + h / 2 * bz, s, drag_per_m, lift)
    dx, dy, dz = acceleration(vx + h * cx, vy + h * cy, vz + h * cz, s, drag_per_m, lift)
    out[0] = s[0] + h * (vx + h / 6 * (ax + bx + cx))
    out[1] = s[1] + h * (vy + h / 6 * (ay + by + cy))
    out[2] = s[2] + h * (vz + h / 6 * (az + bz + cz))
    out[3] = vx + h / 6 * (ax + 2 * bx + 2 * cx + dx)
    out[4] = vy + h / 6 * (ay + 2 * by + 2 * cy + dy)
    out[5] = vz + h / 6 * (az + 2 * bz + 2 * cz + dz)


@njit
def fly(s: Array, h: float, air: Air, out: Array) -> None:
    """Write the state `h` seconds after `s` to `out` (may be `s`): one parabola, or one Runge-Kutta step.

    Args:
        s: (9,) position, velocity and spin: m, m/s, rad/s.
        h: duration, s; in air no longer than `air.step_s` for its accuracy.
        air: drag and lift, or none.
        out: (9,) output.
    """
    out[6:9] = s[6:9]
    if air.acts:
        rk4_step(s, h, air.drag_per_m, air.lift, out)
        return
    vx, vy, vz = s[3], s[4], s[5]
    out[0] = s[0] + vx * h
    out[1] = s[1] + vy * h
    out[2] = s[2] + vz * h - 0.5 * GRAVITY_MPS2 * h * h
    out[3], out[4], out[5] = vx, vy, vz - GRAVITY_MPS2 * h


@njit
def _fall_time(g: float, rate: float, half_curvature: float) -> float:
    """First t >= 0 at which g + rate t + half_curvature t^2 goes from positive to negative; NaN if it never does."""
    discriminant = rate * rate - 4 * half_curvature * g
    if discriminant < 0:
        return math.nan
    root = math.sqrt(discriminant)
    if rate <= 0:
        if root == rate:
            return math.nan
        t = 2 * g / (root - rate)
    elif half_curvature < 0:
        t = (-rate - root) / (2 * half_curvature)
    else:
        return math.nan
    return t if t >= -1e-12 else math.nan


@njit
def fall_through(s: Array, plane: tuple[float, float, float, float, float], air: Air, out: Array) -> float:
    """When a x + b y + c z + d t + e first falls from positive to negative, or NaN; the state then goes to `out`.

    `plane` is (a, b, c, d, e), t counts from the state `s`. A plane that moves with constant velocity has d != 0.

    Args:
        s: (9,) position, velocity and spin.
        plane: its five coefficients: of x, y, z (m), of t (s), and the constant.
        air: drag and lift, or none.
        out: (9,) output.
    """
    a, b, c, d, e = plane
    g = a * s[0] + b * s[1] + c * s[2] + e
    if not air.acts:
        t = _fall_time(g, a * s[3] + b * s[4] + c * s[5] + d, -0.5 * c * GRAVITY_MPS2)
        if not math.isnan(t):
            fly(s, max(t, 0.0), air, out)
        return t
    before = s.copy()
    after = np.empty(9)
    h = air.step_s
    elapsed = 0.0
    while elapsed < MAX_FLIGHT_S:
        fly(before, h, air, after)
        g_after = a * after[0] + b * after[1] + c * after[2] + d * (elapsed + h) + e
        if g >= 0 and g_after < 0:
            # In `_locate` time begins at this step, by which the plane has moved.
            return elapsed + _locate(before, (a, b, c, d, e + d * elapsed), g, g_after, air, out)
        before[:] = after
        g = g_after
        elapsed += h
    return math.nan


@njit
def _locate(
    s: Array, plane: tuple[float, float, float, float, float], low_g: float, high_g: float, air: Air, out: Array
) -> float:
    """The crossing inside one step, by false position with the Illinois rule on steps of the same integrator."""
    a, b, c, d, e = plane
    low, high = 0.0, air.step_s
    t = low
    side = 0
    for _ in range(60):
        t = (low * high_g - high * low_g) / (high_g - low_g)
        fly(s, t, air, out)
        g = a * out[0] + b * out[1] + c * out[2] + d * t + e
        if abs(g) < 1e-13 or high - low < 1e-15:
            break
        if g > 0:
            low, low_g = t, g
            if side == 1:
                high_g /= 2
            side = 1
        else:
            high, high_g = t, g
            if side == -1:
                low_g /= 2
            side = -1
    return t
