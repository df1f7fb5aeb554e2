"""The bounce of a hollow ball on the table: restitution and Coulomb friction at the point of contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class BounceConfig:
    """What the table does to the ball."""

    restitution: float = setting(0.90, 0.5, 1.0)
    """Vertical speed after over before. The ITTF law (23 cm after a 30 cm drop) is 0.88 at 2.4 m/s."""
    friction: float = setting(0.15, 0.0, 1.0)
    """Coulomb coefficient. A choice: literature has 0.1 to 0.3; 0.25 stops a 3 m/s serve before the hitting plane."""

    def __post_init__(self) -> None:
        check_settings(self)


def bounce_on_table(v_mps: Array, spin_radps: Array, config: BounceConfig) -> tuple[Array, Array]:
    """Velocity (3,) and spin (3,) after a ball with these hits a horizontal table from above.

    A thin shell, inertia 2/3 m r^2. The impulse is m (1 + e) |vz| up and at most friction times that along the table;
    2/5 m u of it stops the contact point, whose velocity u is, and the ball rolls from then on.
    """
    up = np.array([0.0, 0.0, 1.0])
    contact_velocity = v_mps + np.cross(spin_radps, -BALL_RADIUS_M * up)
    slip = np.array([contact_velocity[0], contact_velocity[1], 0.0])
    slip_speed = float(np.linalg.norm(slip))
    normal_speed = (1.0 + config.restitution) * abs(v_mps[2])
    share = min(0.4, config.friction * normal_speed / slip_speed) if slip_speed > 0 else 0.0
    v_after = v_mps - share * slip
    v_after[2] = -config.restitution * v_mps[2]
    spin_after = spin_radps + 1.5 * share / BALL_RADIUS_M * np.cross(up, slip)
    return v_after, spin_after
