"""Rigid impacts of the ball: a hollow sphere, restitution along the normal, Coulomb friction at the contact point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics.config import PhysicsConfig
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]

STICK = 0.4
"""Tangential impulse per mass that stops the contact point of a thin shell, over its speed: 1 / (1 + m r^2 / I), with
I = 2/3 m r^2. A slower stop than a point mass's 1 because half of the push goes into spin."""
SPIN_PER_IMPULSE = 1.5 / BALL_RADIUS_M
"""m r / I: change of spin per tangential impulse per mass."""


class Surface(NamedTuple):
    """Constants of one surface as the kernels take them; see the config for their meaning."""

    restitution: float
    restitution_loss: float
    tangential_restitution: float
    tangential_loss: float
    friction: float
    spin_retention: float


def surfaces_from_config(physics: PhysicsConfig) -> tuple[Surface, Surface]:
    """The table and the rubber."""
    table, rubber = physics.table, physics.rubber
    return (
        Surface(table.restitution, table.restitution_loss_s_per_m, 0.0, 0.0, table.friction, 1.0),
        Surface(
            rubber.restitution,
            rubber.restitution_loss_s_per_m,
            rubber.tangential_restitution,
            rubber.tangential_loss_s_per_m,
            rubber.friction,
            rubber.spin_retention,
        ),
    )


@njit
def strike(
    s: Array,
    normal: tuple[float, float, float],
    wall: tuple[float, float, float],
    surface: Surface,
) -> None:
    """Change the velocity and spin of state `s` (9,) by the impact on a surface whose contact point moves with `wall`.

    `normal` points from the surface to the ball. A ball that already leaves the surface is not touched.

    Args:
        s: (9,) position, velocity and spin, changed in place: m, m/s, rad/s.
        normal: unit vector from the surface to the ball.
        wall: velocity of the contact point, m/s.
        surface: restitution and friction.
    """
    nx, ny, nz = normal
    rx, ry, rz = s[3] - wall[0], s[4] - wall[1], s[5] - wall[2]
    vn = rx * nx + ry * ny + rz * nz
    if vn >= 0:
        return
    wx, wy, wz = s[6], s[7], s[8]
    # Velocity of the contact point, at -r n from the centre: the tangential part of v + spin x (-r n).
    ux = rx - vn * nx - BALL_RADIUS_M * (wy * nz - wz * ny)
    uy = ry - vn * ny - BALL_RADIUS_M * (wz * nx - wx * nz)
    uz = rz - vn * nz - BALL_RADIUS_M * (wx * ny - wy * nx)
    slip = math.sqrt(ux * ux + uy * uy + uz * uz)
    restitution = max(surface.restitution + surface.restitution_loss * vn, 0.0)
    jn = -(1 + restitution) * vn
    jt_over_slip = 0.0
    if slip > 0:
        kick = min(max(surface.tangential_restitution - surface.tangential_loss * slip, 0.0), 0.95)
        jt_over_slip = -min(STICK * (1 + kick), surface.friction * jn / slip)
    jx, jy, jz = jt_over_slip * ux, jt_over_slip * uy, jt_over_slip * uz
    s[3] += jn * nx + jx
    s[4] += jn * ny + jy
    s[5] += jn * nz + jz
    lost = (1 - surface.spin_retention) * (wx * nx + wy * ny + wz * nz)
    s[6] = wx - SPIN_PER_IMPULSE * (ny * jz - nz * jy) - lost * nx
    s[7] = wy - SPIN_PER_IMPULSE * (nz * jx - nx * jz) - lost * ny
    s[8] = wz - SPIN_PER_IMPULSE * (nx * jy - ny * jx) - lost * nz
