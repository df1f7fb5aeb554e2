"""Values of the one-step task as arrays over episodes: serves, arrivals, strokes, outcomes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.physics.rotation import orientations_from_actions
from core.physics.task import StrokeConfig

Array = NDArray[np.float64]


class Case(IntEnum):
    """The outcome of a stroke, by the first contact after the racket (the paper's four cases), or no contact at all."""

    OWN_HALF = 1
    NET = 2
    OUT = 3
    RETURNED = 4
    MISSED = 5


CASE_OF_CONTACT: Final = np.array(
    [Case.OUT, Case.OWN_HALF, Case.NET, Case.OUT, Case.RETURNED, Case.OWN_HALF, Case.OUT], np.int8
)
"""Case for each code of `contact`: nothing, own top, net, floor, far top, own end, far end."""


class TimedStates(NamedTuple):
    """Balls at one moment each; NaN for a ball that has none."""

    t_s: Array
    """(N,)."""
    states: Array
    """(N, 9) position, velocity and spin."""

    @staticmethod
    def unknown(count: int) -> TimedStates:
        """States that are all NaN, to be filled in."""
        return TimedStates(np.full(count, np.nan), np.full((count, 9), np.nan))


@dataclass(frozen=True, slots=True, eq=False)
class Serves:
    """Launched balls; time counts from the launch."""

    ps_m: Array
    """(N, 3), world."""
    vs_mps: Array
    """(N, 3)."""
    spins_radps: Array
    """(N, 3), right-handed, world."""

    def __len__(self) -> int:
        return len(self.ps_m)

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Serves:
        return Serves(self.ps_m[which], self.vs_mps[which], self.spins_radps[which])

    def states(self) -> Array:
        """(N, 9): position, velocity, spin."""
        return np.concatenate([self.ps_m, self.vs_mps, self.spins_radps], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Arrivals:
    """Serves at the hitting plane; NaN where a serve does not get there."""

    legal: NDArray[np.bool_]
    """(N,) from the far side over the net, exactly one bounce, on the robot's half, then the hitting plane."""
    bounce_t_s: Array
    """(N,) last bounce before the plane."""
    bounce_states: Array
    """(N, 9) just after that bounce."""
    t_s: Array
    """(N,) when the ball's centre crosses the hitting plane: t_c."""
    states: Array
    """(N, 9) there."""

    @property
    def observations(self) -> Array:
        """(N, 6): p_c and v_c, the state of the decision."""
        return self.states[:, :6]


@dataclass(frozen=True, slots=True, eq=False)
class Strokes:
    """Strokes: an orientation and a constant velocity of the racket through the impact.

    Without an aim the racket is where the ball is: the middle of its face meets the ball in the hitting plane. With one
    it goes to where the ball was predicted to be, and the ball may meet it off the middle, early, late, or not at all.
    """

    qs_wxyz: Array
    """(N, 4) racket orientation, local to world; the face's normal is its x axis."""
    vs_mps: Array
    """(N, 3) racket velocity."""
    aim_ps_m: Array | None = None
    """(N, 3) where the ball's centre is expected at the impact."""
    aim_t_s: Array | None = None
    """(N,) and when."""

    def __post_init__(self) -> None:
        if (self.aim_ps_m is None) != (self.aim_t_s is None):
            raise ConfigError("half an aim", expected="both aim_ps_m and aim_t_s, or neither", where="Strokes")

    def __len__(self) -> int:
        return len(self.qs_wxyz)


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """Outcomes of the strokes. Everything but `case` is NaN where the racket missed."""

    case: NDArray[np.int8]
    """(N,) values of `Case`."""
    hit_t_s: Array
    """(N,)."""
    hit_states: Array
    """(N, 9) just after the impact."""
    landing_t_s: Array
    """(N,)."""
    landing_states: Array
    """(N, 9) where the ball comes down to the table's plane, net and floor ignored: f and, with the velocity, s'.
    A ball that never rises to that plane counts at its highest point."""
    net_z_m: Array
    """(N,) height of the ball's centre over x = 0 on the same extrapolated flight; NaN if it never gets there."""
    contact_t_s: Array
    """(N,) first contact after the racket."""
    contact_states: Array
    """(N, 9) just before it."""

    def __len__(self) -> int:
        return len(self.case)

    @property
    def returned(self) -> NDArray[np.bool_]:
        """Whether each ball (N,) came back onto the far half: case 4."""
        return self.case == Case.RETURNED

    @property
    def landings_m(self) -> Array:
        """(N, 2) landing points f in the table's plane."""
        return self.landing_states[:, :2]


def strokes_from_actions(
    actions: ArrayLike,
    racket_speed_mps: ArrayLike,
    stroke: StrokeConfig,
    *,
    aim_ps_m: Array | None = None,
    aim_t_s: Array | None = None,
) -> Strokes:
    """Strokes of actions (N, 3) in [-1, 1] with the racket moving along +x at one speed or one per episode.

    Args:
        actions: (N, 3) in [-1, 1].
        racket_speed_mps: of the racket along +x, one or (N,).
        stroke: gives the base orientation and the largest angles.
        aim_ps_m: (N, 3) where the ball is expected at the impact; None: where it is.
        aim_t_s: (N,) and when.
    """
    qs = orientations_from_actions(actions, stroke)
    vs = np.zeros((len(qs), 3))
    vs[:, 0] = racket_speed_mps
    return Strokes(qs, vs, aim_ps_m, aim_t_s)
