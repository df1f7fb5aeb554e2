"""Who is in a scene: the bodies that belong to its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.simulation.bodies.parts import MovingBodies, rod
from core.simulation.bodies.person import FLOOR_M, Clothes, PlayerBody, Walker
from core.simulation.bodies.strokes import PlayerStroke, RacketMotion, practice
from core.simulation.scenes.scene import ActorsName

Array = NDArray[np.float64]

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
