"""What the landing model's three outputs mean: the landing and the height at the net themselves, or the ball's velocity
after the stroke, from which gravity gives both. Gravity is the one thing about the flight that need not be learned.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from core.learning.normalise import LANDING_CENTRE, LANDING_SCALE
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

SLOWEST_MPS = 0.3
"""Slower towards the net, or slower coming down, counts as this: such a ball does not come near the net."""


class Head(Protocol):
    """Outputs (B, 3) of a network to landing x, y and height at the net (m), and the way back for gradients."""

    def decode(self, outputs: Tensor, ps_m: Tensor) -> Tensor:
        """(B, 3) for balls struck at `ps_m` (B, 3)."""
        ...

    def pull(self, slope: Tensor) -> Tensor:
        """d loss / d outputs from d loss / d decoded, for the last `decode`."""
        ...


class FreeHead:
    """The outputs are the landing and the height, scaled."""

    def __init__(self) -> None:
        self._centre = torch.tensor(LANDING_CENTRE, dtype=torch.float32)
        self._scale = torch.tensor(LANDING_SCALE, dtype=torch.float32)

    def decode(self, outputs: Tensor, ps_m: Tensor) -> Tensor:
        return outputs * self._scale + self._centre

    def pull(self, slope: Tensor) -> Tensor:
        return slope * self._scale


class FlightHead:
    """The outputs are the velocity after the stroke, scaled; landing and height follow from a parabola."""

    def __init__(self) -> None:
        self._centre = torch.tensor([3.5, 0.0, 1.5])
        self._scale = torch.tensor([1.2, 0.8, 1.2])
        self._jacobian = torch.zeros(0)

    def decode(self, outputs: Tensor, ps_m: Tensor) -> Tensor:
        v = outputs * self._scale + self._centre
        vx, vy, vz = v[:, 0], v[:, 1], v[:, 2]
        g, drop = GRAVITY_MPS2, ps_m[:, 2] - BALL_RADIUS_M
        # Speed at which the ball comes down to the table's plane; a racket below the plane may not reach it at all.
        down = (vz * vz + 2 * g * drop).clamp_min(SLOWEST_MPS**2).sqrt_()
        t = (vz + down) / g
        forward = vx.clamp_min(SLOWEST_MPS)
        t_net = -ps_m[:, 0] / forward
        z_net = ps_m[:, 2] + vz * t_net - 0.5 * g * t_net * t_net
        late = t / down
        zero = torch.zeros_like(t)
        slower = torch.where(vx > SLOWEST_MPS, (g * t_net - vz) * t_net / forward, zero)
        rows = [t, zero, vx * late, zero, t, vy * late, slower, zero, t_net]
        self._jacobian = torch.stack(rows, 1).view(-1, 3, 3)
        return torch.stack([ps_m[:, 0] + vx * t, ps_m[:, 1] + vy * t, z_net], 1)

    def pull(self, slope: Tensor) -> Tensor:
        return torch.bmm(slope[:, None], self._jacobian)[:, 0] * self._scale
