"""Output heads of the landing model. `free`: the landing and the height at the net themselves. `flight`: the ball's
velocity after the stroke, from which gravity gives both. `impact`: how much of its speed the rubber gives back and how
well it grips, from which the law of reflection gives that velocity: its form is known, its numbers are learned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from core.learning.task.normalise import LANDING_CENTRE, LANDING_SCALE
from core.physics.task import StrokeConfig
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

RESTITUTION, GRIP, PUSH_MPS = (0.6, 0.2), (0.3, 0.2), 0.03
"""Centre and scale of the impact head's outputs: a guess to start from, not the simulator's numbers (0.78 and 0.4).
The push is small, so that it is learned last."""
SLOWEST_MPS = 0.3
"""Lower bound of the speeds towards the net and downwards: slower balls do not come near the net."""


@dataclass(frozen=True, slots=True, eq=False)
class Balls:
    """Known states of balls at the racket, and the strokes."""

    states: Tensor
    """(B, 6) position and velocity, or (B, 12) with spin and its uncertainty."""
    racket_mps: Tensor
    """(B, 1) speed of the racket along +x."""
    actions: Tensor
    """(B, 3), or (B, 4) with the racket's speed."""


class Head(Protocol):
    """Outputs of a network to landing x, y and height at the net (m)."""

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        ...

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        """(B, 3) of outputs (B, outputs)."""
        ...


class FreeHead:
    """The outputs are the landing and the height, scaled."""

    outputs = 3

    def __init__(self) -> None:
        self._centre = torch.tensor(LANDING_CENTRE, dtype=torch.float32)
        self._scale = torch.tensor(LANDING_SCALE, dtype=torch.float32)

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        return outputs * self._scale + self._centre


class FlightHead:
    """The outputs are the velocity after the stroke, scaled; landing and height follow from a parabola."""

    outputs = 3

    def __init__(self) -> None:
        self._centre = torch.tensor([3.5, 0.0, 1.5])
        self._scale = torch.tensor([1.2, 0.8, 1.2])

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        return fly_to_landing(outputs * self._scale + self._centre, balls.states)


class ImpactHead:
    """The outputs are restitution, grip, and a push that neither explains (spin, a racket that is not quite where it
    was sent); the velocity after the stroke follows from the face's normal, and the rest from a parabola.
    """

    outputs = 5

    def __init__(self, stroke: StrokeConfig) -> None:
        self._limit = math.radians(stroke.action_limit_deg)
        base = math.radians(stroke.base_pitch_deg)
        self._base = torch.tensor(
            [[math.cos(base), 0, -math.sin(base)], [0, 1, 0], [math.sin(base), 0, math.cos(base)]],
        )

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        normal = normals_of(balls.actions[:, :3] * self._limit) @ self._base.T
        racket = torch.nn.functional.pad(balls.racket_mps, (0, 2))
        arriving = balls.states[:, 3:6] - racket
        towards = (arriving * normal).sum(1, keepdim=True)
        restitution = RESTITUTION[0] + RESTITUTION[1] * outputs[:, :1]
        kept = 1 - GRIP[0] - GRIP[1] * outputs[:, 1:2]
        velocity = racket + kept * arriving - (restitution + kept) * towards * normal + PUSH_MPS * outputs[:, 2:]
        if balls.states.shape[1] > 6:  # the contact point's velocity includes the spin
            spin_there = torch.linalg.cross(balls.states[:, 6:9], normal)
            velocity = velocity + (1 - kept) * BALL_RADIUS_M * spin_there
        return fly_to_landing(velocity, balls.states)


def normals_of(angles_rad: Tensor) -> Tensor:
    """(B, 3) of the face on an upright base: the x axis after turns (B, 3) about x, y and z."""
    s, c = torch.sin(angles_rad), torch.cos(angles_rad)
    forward, side, up = c[:, 1] * c[:, 2], s[:, 2], -s[:, 1] * c[:, 2]
    return torch.stack([forward, c[:, 0] * side - s[:, 0] * up, s[:, 0] * side + c[:, 0] * up], 1)


def fly_to_landing(v: Tensor, states: Tensor) -> Tensor:
    """Landing x, y and height at the net (B, 3) of balls that leave with velocities v (B, 3)."""
    vx, vy, vz = v[:, 0], v[:, 1], v[:, 2]
    drop = states[:, 2] - BALL_RADIUS_M
    # Speed at which the ball comes down to the table's plane; a racket below the plane may not reach it at all.
    down = (vz * vz + 2 * GRAVITY_MPS2 * drop).clamp_min(SLOWEST_MPS**2).sqrt()
    t = (vz + down) / GRAVITY_MPS2
    t_net = -states[:, 0] / vx.clamp_min(SLOWEST_MPS)
    z_net = states[:, 2] + vz * t_net - 0.5 * GRAVITY_MPS2 * t_net * t_net
    return torch.stack([states[:, 0] + vx * t, states[:, 1] + vy * t, z_net], 1)
