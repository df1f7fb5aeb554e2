"""What an opponent's ball does before the robot can hit it: which balls are to be played, why others are not, and
serves drawn from recorded balls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.jit import njit
from core.physics import contact
from core.physics.contact import next_contact
from core.physics.episode import Arrivals, Serves, TimedStates
from core.physics.flight import Air, air_from_config, fall_through
from core.physics.impact import Surface, strike, surfaces_from_config
from core.physics.task import TaskConfig
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]

_UP = (0.0, 0.0, 1.0)
_STILL = (0.0, 0.0, 0.0)
MAX_BOUNCES = 8


class Incoming(IntEnum):
    """Why a ball is or is not the robot's to hit."""

    PLAYABLE = 0
    """One bounce, on the robot's half, then the hitting plane. A service may bounce on the server's half first."""
    NET = 1
    """It touches the net."""
    NO_BOUNCE = 2
    """It passes the robot's half without a bounce, beyond its end or beside it."""
    FAR_HALF = 3
    """It comes down on the opponent's half and does not come over, or does so twice."""
    TWO_BOUNCES = 4
    """It bounces twice on the robot's half before the hitting plane: too short for a robot that waits there."""
    SHORT = 5
    """It bounces once and falls beside the table before the hitting plane."""


_WHY = (Incoming.NET, Incoming.NO_BOUNCE, Incoming.FAR_HALF, Incoming.TWO_BOUNCES, Incoming.SHORT, Incoming.PLAYABLE)
_NET, _NO_BOUNCE, _FAR_HALF, _TWO_BOUNCES, _SHORT, _PLAYABLE = (int(one) for one in _WHY)


@dataclass(frozen=True, slots=True, eq=False)
class IncomingBalls:
    """What struck balls do, each up to the hitting plane or to what ends it."""

    incoming: NDArray[np.int8]
    """(N,) values of `Incoming`."""
    is_service: NDArray[np.bool_]
    """(N,) it bounces on the opponent's half first."""
    arrivals: Arrivals
    """At the hitting plane; `legal` is what is playable, everything else is NaN."""


def fly_incoming(balls: Serves, config: TaskConfig) -> IncomingBalls:
    """Every ball up to the hitting plane."""
    n = len(balls)
    incoming, is_service = np.full(n, _NO_BOUNCE, np.int8), np.zeros(n, np.bool_)
    bounces, arrivals = TimedStates.unknown(n), TimedStates.unknown(n)
    _fly(
        np.ascontiguousarray(balls.states()),
        config.stroke.hit_plane_x_m,
        air_from_config(config.physics),
        surfaces_from_config(config.physics)[0],
        incoming,
        is_service,
        bounces,
        arrivals,
    )
    legal = incoming == Incoming.PLAYABLE
    for column in (*bounces, *arrivals):
        column[~legal] = np.nan
    return IncomingBalls(incoming, is_service, Arrivals(legal, *bounces, *arrivals))


@njit
def _fly(
    balls: Array,
    hit_x: float,
    air: Air,
    table: Surface,
    incoming: NDArray[np.int8],
    is_service: NDArray[np.bool_],
    bounces: TimedStates,
    arrivals: TimedStates,
) -> None:
    touched, at_plane, s = np.empty(9), np.empty(9), np.empty(9)
    for i in range(len(balls)):
        s[:] = balls[i]
        t = 0.0
        near = far = 0
        for _ in range(MAX_BOUNCES):
            what, dt = next_contact(s, air, touched)
            dt_plane = fall_through(s, (1.0, 0.0, 0.0, 0.0, -hit_x), air, at_plane)
            if not math.isnan(dt_plane) and dt_plane <= dt:
                incoming[i] = _PLAYABLE if near == 1 else _NO_BOUNCE
                arrivals.t_s[i] = t + dt_plane
                arrivals.states[i] = at_plane
                break
            if what == contact.NET:
                incoming[i] = _NET
                break
            if what == contact.FAR_TOP:
                far += 1
                # Only a service touches the server's own half first.
                is_service[i] = near == 0
                if far > 1 or near > 0:
                    incoming[i] = _FAR_HALF
                    break
            elif what == contact.OWN_TOP:
                near += 1
                if near > 1:
                    incoming[i] = _TWO_BOUNCES
                    break
            else:
                incoming[i] = _SHORT if near == 1 else _FAR_HALF if far else _NO_BOUNCE
                break
            t += dt
            s[:] = touched
            strike(s, _UP, _STILL, table)
            s[2] = BALL_RADIUS_M
            if near:
                bounces.t_s[i] = t
                bounces.states[i] = s


NEAR_MPS: Final = 0.25
"""Balls whose speed differs by no more count as having the speed that is asked for."""


class RecordedServes:
    """The playable ones among recorded balls: they bounce on the robot's half and come to the hitting plane."""

    def __init__(self, balls: Serves, config: TaskConfig) -> None:
        """Keep what is playable in the physics of `config`.

        Raises:
            ConfigError: if nothing is.
        """
        playable = balls[fly_incoming(balls, config).incoming == Incoming.PLAYABLE]
        if not len(playable):
            raise ConfigError("none of the balls is playable", got=f"{len(balls)} ball states")
        speeds_mps = np.linalg.norm(playable.vs_mps, axis=1)
        order = np.argsort(speeds_mps, kind="stable")
        self.balls = playable[order]
        """Serves ordered by ascending speed."""
        self._speeds_mps = speeds_mps[order]

    def draw(self, speed_mps: float, rng: np.random.Generator) -> Serves:
        """One of the balls with this speed at the recorded state, at random; the nearest one if there is none."""
        first = int(np.searchsorted(self._speeds_mps, speed_mps - NEAR_MPS))
        last = int(np.searchsorted(self._speeds_mps, speed_mps + NEAR_MPS, side="right"))
        nearest = int(np.abs(self._speeds_mps - speed_mps).argmin())
        which = int(rng.integers(first, last)) if first < last else nearest
        return self.balls[which : which + 1]
