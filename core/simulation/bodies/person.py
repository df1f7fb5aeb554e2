"""An articulated person of rounded rods: a player with a racket, or somebody who walks by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.simulation.bodies.parts import blade, rod
from core.simulation.bodies.strokes import RacketMotion
from core.table import TABLE_HEIGHT_M

Array = NDArray[np.float64]

FLOOR_M: Final = -TABLE_HEIGHT_M
HIP_M, CHEST_M = 0.86, 0.46
"""Height of the hips of a player in ready pose above the floor; of the chest above the hips (an adult of 1.75 m)."""
THIGH_M, SHIN_M, UPPER_ARM_M, FOREARM_M = 0.44, 0.44, 0.30, 0.27
BLADE_RADIUS_M, BLADE_THICKNESS_M, GRIP_M = 0.077, 0.012, 0.13
STRIDE_M: Final = 0.9
UP: Final = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Clothes:
    """Reflectances in near infrared, 0 black to 1 white (choice)."""

    shirt: float
    shorts: float
    skin: float = 0.45
    hair: float = 0.08
    texture: float = 0.5
    """Depth of the pattern on shirt and shorts; half as much on the limbs."""


def person_parts(clothes: Clothes, *, with_racket: bool) -> Array:
    """(16 or 14, PART_COLUMNS): head, hair, trunk, hips; upper arms, forearms, thighs, shins and shoes in pairs;
    grip and blade.
    """
    cloth, limb = clothes.texture, 0.5 * clothes.texture
    rows = [
        rod(0.085, 0.095, clothes.skin, texture=0.25, stripes_per_m=14.0, bands=2.0),
        rod(0.100, 0.100, clothes.hair, texture=0.3, bands=6.0),
        rod(0.135, 0.165, clothes.shirt, texture=cloth, stripes_per_m=9.0, bands=3.0),
        rod(0.135, 0.135, clothes.shorts, texture=limb, stripes_per_m=5.0, bands=2.0),
        *(rod(0.055, 0.045, clothes.shirt, texture=limb, stripes_per_m=11.0, bands=2.0) for _ in range(2)),
        *(rod(0.042, 0.032, clothes.skin, texture=limb, stripes_per_m=8.0, bands=2.0) for _ in range(2)),
        *(rod(0.085, 0.060, clothes.shorts, texture=limb, stripes_per_m=6.0, bands=2.0) for _ in range(2)),
        *(rod(0.055, 0.040, clothes.skin, texture=limb, stripes_per_m=5.0, bands=1.0) for _ in range(2)),
        *(rod(0.045, 0.040, 0.6) for _ in range(2)),
    ]
    if with_racket:
        rows += [rod(0.018, 0.016, 0.35), blade(BLADE_RADIUS_M, 0.05)]
    return np.array(rows)


@dataclass(frozen=True, slots=True, eq=False)
class PlayerBody:
    """A person with a racket."""

    motion: RacketMotion
    forward: Array
    """(3,) unit vector that the person looks along."""
    side: Array
    """(3,) unit vector towards the hand that plays."""
    clothes: Clothes
    sway_s: float
    """Period of the swaying in the ready pose."""

    @property
    def parts(self) -> Array:
        """The parts of the body, as rows (16, PART_COLUMNS)."""
        return person_parts(self.clothes, with_racket=True)

    def ends(self, t_s: Array) -> Array:
        """(N, 16, 2, 3), see `MovingBodies`."""
        face, normal, stand = self.motion.at(t_s)
        phase = 2 * np.pi * t_s / self.sway_s
        base = stand + np.outer(0.03 * np.sin(phase), self.side)
        hips = base + (HIP_M + 0.02 * np.sin(2 * phase))[:, None] * UP
        outward = self.side - np.einsum("ij,j->i", normal, self.side)[:, None] * normal + 1e-6
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        hand = face - GRIP_M * outward
        chest = hips + CHEST_M * UP + 0.12 * self.forward
        other = chest - 0.30 * self.side + 0.22 * self.forward - 0.25 * UP
        other = other + np.outer(0.05 * np.sin(phase + 1.0), self.forward)
        feet = [base + sign * 0.20 * self.side + 0.05 * UP for sign in (1.0, -1.0)]
        body = _body(hips, chest, self.forward, self.side, (hand, other), feet)
        grip = np.stack([hand, hand + 0.06 * outward], axis=1)
        blade_ends = np.stack([face, face - BLADE_THICKNESS_M * normal], axis=1)
        return np.concatenate([body, grip[:, None], blade_ends[:, None]], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Walker:
    """A person who walks to and fro along a line."""

    middle_m: Array
    """(3,) on the floor."""
    along: Array
    """(3,) unit vector of the line."""
    reach_m: float
    period_s: float
    clothes: Clothes

    @property
    def parts(self) -> Array:
        """(14, PART_COLUMNS), without a racket."""
        return person_parts(self.clothes, with_racket=False)

    def ends(self, t_s: Array) -> Array:
        """(N, 14, 2, 3), see `MovingBodies`."""
        turn = 2 * np.pi * t_s / self.period_s
        walked = self.reach_m * np.sin(turn)
        base = self.middle_m + np.outer(walked, self.along)
        gait = 2 * np.pi * walked / STRIDE_M
        side = np.cross(UP, self.along)
        hips = base + (HIP_M + 0.02 * np.cos(2 * gait))[:, None] * UP
        chest = hips + CHEST_M * UP + 0.03 * self.along
        hands, feet = [], []
        for sign in (1.0, -1.0):
            step = np.outer(0.22 * np.sin(gait) * sign, self.along)
            lift = (0.05 + 0.06 * np.maximum(np.cos(gait) * sign, 0.0))[:, None] * UP
            feet.append(base + sign * 0.09 * side + step + lift)
            hands.append(chest + sign * 0.26 * side - 0.9 * step - 0.45 * UP + 0.05 * self.along)
        return _body(hips, chest, self.along, side, hands, feet)


def _body(
    hips: Array, chest: Array, forward: Array, side: Array, hands: tuple[Array, Array] | list[Array], feet: list[Array]
) -> Array:
    """(N, 14, 2, 3) ends of the parts of `person_parts`, the first hand and foot on the side `side`."""
    head = chest + 0.27 * UP + 0.05 * forward
    rods = [
        (head - 0.03 * UP + 0.02 * forward, head + 0.02 * UP + 0.02 * forward),
        (head + 0.03 * UP - 0.02 * forward, head + 0.03 * UP - 0.02 * forward),
        (hips + 0.12 * UP, chest),
        (hips - 0.03 * side, hips + 0.03 * side),
    ]
    upper, lower = [], []
    for sign, hand in zip((1.0, -1.0), hands, strict=True):
        shoulder = chest + sign * 0.19 * side
        elbow, reached = _two_bones(shoulder, hand, UPPER_ARM_M, FOREARM_M, sign * 0.5 * side - UP)
        upper.append((shoulder, elbow))
        lower.append((elbow, reached))
    rods += upper + lower
    thighs, shins, shoes = [], [], []
    for sign, foot in zip((1.0, -1.0), feet, strict=True):
        hip = hips + sign * 0.09 * side
        knee, reached = _two_bones(hip, foot, THIGH_M, SHIN_M, forward)
        thighs.append((hip, knee))
        shins.append((knee, reached))
        shoes.append((reached - 0.04 * forward, reached + 0.16 * forward))
    rods += thighs + shins + shoes
    return np.stack([np.stack(ends, axis=1) for ends in rods], axis=1)


def _two_bones(start: Array, goal: Array, first_m: float, second_m: float, bend: Array) -> tuple[Array, Array]:
    """(joint, end), each (N, 3): two bones from `start` towards `goal`, stretched where it is out of reach."""
    way = goal - start
    distance = np.linalg.norm(way, axis=1, keepdims=True)
    ahead = way / np.maximum(distance, 1e-6)
    distance = np.clip(distance, abs(first_m - second_m) + 0.01, 0.999 * (first_m + second_m))
    along = (first_m**2 - second_m**2 + distance**2) / (2 * distance)
    out = bend - np.einsum("ij,j->i", ahead, bend)[:, None] * ahead
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-6)
    return start + along * ahead + np.sqrt(np.maximum(first_m**2 - along**2, 0.0)) * out, start + distance * ahead
