"""Who is in a scene: players and walkers of rounded rods, how their rackets move, and the bodies of each scene's name.

A racket follows key poses of each stroke, joined by curves that do not overshoot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.simulation.bodies.parts import MovingBodies, blade, rod
from core.simulation.scenes.scene import ActorsName
from core.table import TABLE_HEIGHT_M

Array = NDArray[np.float64]

SWING_BACK_S: Final = 0.28
FOLLOW_S: Final = 0.12
RECOVER_S: Final = 0.50
"""Times of a stroke's key poses before and after the contact (choice: an amateur's drive, 2 to 4 m/s at the blade)."""


@dataclass(frozen=True, slots=True, eq=False)
class PlayerStroke:
    """The blade meets the ball."""

    t_s: float
    p_world_m: Array
    """(3,) of the middle of the blade's face."""
    normal_world: Array
    """(3,) of the face, away from the blade."""


class RacketMotion:
    """Blade and feet of a player who stands at `home` and looks along `forward`, with the racket on side `left`.

    Between strokes the player comes back to a ready pose. With `cycle_s` everything repeats.
    """

    def __init__(
        self, home_m: Array, forward: Array, side: Array, strokes: Sequence[PlayerStroke], cycle_s: float | None
    ) -> None:
        from scipy.interpolate import PchipInterpolator  # loaded late: most scenes have no people

        up = np.array([0.0, 0.0, 1.0])
        ready = home_m + 0.45 * forward + 0.22 * side + 0.12 * up
        at_s, blades, normals, feet = [-1.0], [ready], [forward + 0.2 * up], [home_m]
        for index, stroke in enumerate(strokes):
            stand = stroke.p_world_m - 0.50 * forward - 0.42 * side
            stand = np.array([stand[0], stand[1], home_m[2]])
            poses = (
                (-SWING_BACK_S, stroke.p_world_m - 0.40 * forward + 0.12 * side - 0.08 * up, forward + 0.6 * side),
                (0.0, stroke.p_world_m, stroke.normal_world),
                (FOLLOW_S, stroke.p_world_m + 0.28 * forward - 0.14 * side + 0.22 * up, forward - 0.6 * side),
            )
            for after_s, middle, normal in poses:
                at_s.append(stroke.t_s + after_s)
                blades.append(middle)
                normals.append(normal / np.linalg.norm(normal))
                feet.append(stand)
            following_s = strokes[index + 1].t_s - SWING_BACK_S if index + 1 < len(strokes) else np.inf
            if stroke.t_s + RECOVER_S < following_s - 0.1:
                at_s.append(stroke.t_s + RECOVER_S)
                blades.append(ready)
                normals.append(forward + 0.2 * up)
                feet.append(home_m)
        last_s = max(at_s[-1] + 1.0, cycle_s or 0.0)
        at_s.append(last_s)
        self._first_s, self._last_s, self._cycle_s = at_s[0], last_s, cycle_s
        columns = [np.concatenate(pose) for pose in zip(blades, normals, feet, strict=True)]
        columns.append(np.concatenate([ready, forward + 0.2 * up, home_m]))
        self._curves = PchipInterpolator(at_s, np.array(columns), axis=0)

    def at(self, t_s: Array) -> tuple[Array, Array, Array]:
        """(middle of the face, unit normal, where the player stands), each (N, 3)."""
        t = np.mod(t_s, self._cycle_s) if self._cycle_s is not None else np.clip(t_s, self._first_s, self._last_s)
        values = self._curves(t)
        normals = values[:, 3:6] / np.linalg.norm(values[:, 3:6], axis=1, keepdims=True)
        return values[:, :3], normals, values[:, 6:]


def practice(
    home_m: Array, forward: Array, side: Array, cycle_s: float, rng: np.random.Generator
) -> list[PlayerStroke]:
    """Strokes without a ball, every 1.1 to 2 s, ending before the cycle does.

    Args:
        home_m: (3,) where the player stands, world.
        forward: (3,) unit vector towards the table.
        side: (3,) unit vector to the racket's side.
        cycle_s: length of the cycle.
        rng: source of random numbers.
    """
    strokes, t_s = [], 0.6 + rng.uniform(0.0, 0.8)
    while t_s < cycle_s - 2.0:
        across, height = rng.uniform(-0.25, 0.35), rng.uniform(0.08, 0.40)
        p = home_m + (0.50 + rng.uniform(-0.1, 0.1)) * forward + (0.42 + across) * side
        p[2] = height
        normal = forward + rng.uniform(-0.2, 0.4) * np.array([0.0, 0.0, 1.0])
        strokes.append(PlayerStroke(t_s, p, normal / np.linalg.norm(normal)))
        t_s += rng.uniform(1.1, 2.0)
    return strokes


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


CYCLE_S: Final = 60.0
"""People without a ball repeat themselves after this."""
SWAY_S: Final = 1.2
"""Period of the swaying, a whole part of the cycle."""
FAR_HOME_M: Final = (1.95, 0.40)
NEAR_HOME_M: Final = (-2.15, -0.15)
"""Where the players stand, x and y."""
FAR_CLOTHES: Final = Clothes(shirt=0.55, shorts=0.10)
NEAR_CLOTHES: Final = Clothes(shirt=0.22, shorts=0.30)
WALKER_CLOTHES: Final = Clothes(shirt=0.35, shorts=0.08, texture=0.6)
HEAD_RADIUS_M: Final = 0.11


@dataclass(frozen=True, slots=True, eq=False)
class ActorGroup:
    """Several bodies as one."""

    members: tuple[MovingBodies, ...]

    @property
    def parts(self) -> Array:
        """(P, PART_COLUMNS) of all."""
        return np.concatenate([member.parts for member in self.members])

    def ends(self, t_s: Array) -> Array:
        """(N, P, 2, 3) of all."""
        return np.concatenate([member.ends(t_s) for member in self.members], axis=1)


@dataclass(frozen=True, slots=True)
class FloatingHead:
    """A bright round thing of a head's size that floats to and fro over the table, at times between camera and ball."""

    period_s: float = 6.0

    @property
    def parts(self) -> Array:
        """The one part, as a row (1, PART_COLUMNS)."""
        return np.array([rod(HEAD_RADIUS_M, HEAD_RADIUS_M, 0.55)])

    def ends(self, t_s: Array) -> Array:
        """(N, 1, 2, 3)."""
        turn = 2 * np.pi * t_s / self.period_s
        p = np.stack([-0.3 + 0.25 * np.cos(turn), np.sin(turn), 0.65 + 0.08 * np.sin(2 * turn)], axis=1)
        return np.repeat(p[:, None, None], 2, axis=2)


def make_actors(cast: ActorsName, seed: int, strokes: Sequence[PlayerStroke] = ()) -> MovingBodies | None:
    """The bodies of a cast; the same seed, the same motion, for all cameras.

    `strokes` are those of a rally in order of time: who stands nearer to one plays it. Without them players practise.
    """
    rng = np.random.default_rng([seed, 0xB0D1])
    if cast == "nobody":
        return None
    if cast == "head":
        return FloatingHead()
    far = _player(FAR_HOME_M, FAR_CLOTHES, [stroke for stroke in strokes if stroke.p_world_m[0] > 0], rng)
    if cast == "person":
        return far
    if cast == "two-persons":
        along, middle = np.array([1.0, 0.0, 0.0]), np.array([0.75, -1.25, FLOOR_M])
        return ActorGroup((far, Walker(middle, along, 1.0, 7.0, WALKER_CLOTHES)))
    near = _player(NEAR_HOME_M, NEAR_CLOTHES, [stroke for stroke in strokes if stroke.p_world_m[0] < 0], rng)
    return ActorGroup((far, near))


def _player(
    home_xy: tuple[float, float], clothes: Clothes, strokes: list[PlayerStroke], rng: np.random.Generator
) -> PlayerBody:
    home = np.array([*home_xy, FLOOR_M])
    forward = np.array([-np.sign(home[0]), 0.0, 0.0])
    side = np.array([0.0, -forward[0], 0.0])  # the right hand
    played: Sequence[PlayerStroke] = strokes or practice(home, forward, side, CYCLE_S, rng)
    motion = RacketMotion(home, forward, side, played, None if strokes else CYCLE_S)
    return PlayerBody(motion, forward, side, clothes, SWAY_S)
