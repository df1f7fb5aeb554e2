"""One episode as a continuous path: the ball at any time, from the launch through bounce and stroke to the floor.

The live view, the camera simulation and the truth of the prediction read the same path. Between two knots it is
continued by the integrator that made them, so it has no interpolation error of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.jit import njit
from core.physics import contact
from core.physics.contact import next_contact
from core.physics.episode import Serves, Strokes
from core.physics.flight import Air, air_from_config, fly
from core.physics.impact import strike, surfaces_from_config
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import fly_serves, return_balls
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]
EventKind = Literal["serve", "bounce", "hit", "net", "floor"]

SLOWEST_BOUNCE_MPS = 0.3
"""A ball that comes down slower than this stays down: the path ends."""
NET_STEP_M = 1e-6
"""How far from x = 0 a ball leaves the net, so that it does not touch it again at once."""


@dataclass(frozen=True, slots=True, eq=False)
class BallEvent:
    """Something that happened to the ball."""

    kind: EventKind
    t_s: float
    state: Array
    """(9,) position, velocity, spin just after it."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """The ball's path from `start_s` to `end_s`; outside, its first and last state hold still in space."""

    knots_t_s: Array
    """(K,) ascending; at an impact the knot is the state after it."""
    knots: Array
    """(K, 9)."""
    end_s: float
    events: tuple[BallEvent, ...]
    air: Air

    @property
    def start_s(self) -> float:
        """When the ball is launched."""
        return float(self.knots_t_s[0])

    def at(self, t_s: ArrayLike) -> Array:
        """States (..., 9) at times (...): position, velocity, spin in the world."""
        t = np.clip(np.asarray(t_s, np.float64), self.start_s, self.end_s)
        states = np.empty((t.size, 9))
        index = np.searchsorted(self.knots_t_s, t.ravel(), side="right") - 1
        _continue_knots(self.knots_t_s, self.knots, index, t.ravel(), self.air, states)
        return states.reshape(*t.shape, 9)


def trace_episode(
    serves: Serves, strokes: Strokes | None, config: TaskConfig, *, duration_s: float = 3.0
) -> Trajectory:
    """The path of one serve (arrays of one row) with one stroke, or with none.

    The first contact after the racket is the one that `simulate_episodes` finds; after it the ball bounces on, or falls
    from the net, until it reaches the floor, comes to rest, or `duration_s` is over.

    Args:
        serves: one launch.
        strokes: one stroke; None: no racket.
        config: the task.
        duration_s: longest path.

    Raises:
        ConfigError: if there is not exactly one serve.
    """
    if len(serves) != 1:
        raise ConfigError("a path has one serve", expected=1, got=len(serves), where="trace_episode")
    air = air_from_config(config.physics)
    arrivals = fly_serves(serves, config)
    hit = None
    if strokes is not None:
        outcomes = return_balls(arrivals, strokes, config)
        if not math.isnan(outcomes.hit_t_s[0]):
            hit = BallEvent("hit", float(outcomes.hit_t_s[0]), outcomes.hit_states[0])
    state = serves.states()[0]
    events = [BallEvent("serve", 0.0, state)]
    t, over = 0.0, False
    while not over:
        nxt = _next_event(t, state, hit, air, config)
        if nxt is None or nxt.t_s > duration_s:
            break
        events.append(nxt)
        t, state = nxt.t_s, nxt.state
        if nxt.kind == "hit":
            hit = None
        # Ever shorter bounces have no end of their own.
        over = nxt.kind == "floor" or (nxt.kind == "bounce" and state[5] < SLOWEST_BOUNCE_MPS)
    end_s = t if over else duration_s
    knots_t, knots = _knots(events, end_s, air)
    return Trajectory(knots_t, knots, end_s, tuple(events), air)


def _next_event(t: float, state: Array, hit: BallEvent | None, air: Air, config: TaskConfig) -> BallEvent | None:
    after = np.empty(9)
    what, dt = next_contact(np.ascontiguousarray(state), air, after)
    if hit is not None and hit.t_s <= t + dt:
        return hit
    if what == contact.NOTHING:
        return None
    if what in (contact.OWN_TOP, contact.FAR_TOP):
        table, _ = surfaces_from_config(config.physics)
        strike(after, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), table)
        after[2] = BALL_RADIUS_M
        return BallEvent("bounce", t + dt, after)
    if what == contact.FLOOR:
        return BallEvent("floor", t + dt, after)
    rebound_from_wall(after, config)
    return BallEvent("net", t + dt, after)


def rebound_from_wall(state: Array, config: TaskConfig) -> None:
    """Turn the ball `state` (9,) back from the net or the table's end with little speed (choice, for the picture)."""
    heading = math.copysign(1.0, state[3])
    state[0] -= heading * NET_STEP_M
    state[3] *= -config.physics.net_restitution
    state[4:6] *= 1 - config.physics.net_drag
    state[6:9] *= 1 - config.physics.net_drag


def _knots(events: list[BallEvent], end_s: float, air: Air) -> tuple[Array, Array]:
    times, states = [], []
    ends = [event.t_s for event in events[1:]] + [end_s]
    for event, end in zip(events, ends, strict=True):
        t, state = event.t_s, event.state.copy()
        times.append(t)
        states.append(state.copy())
        while air.acts and end - t > air.step_s:
            fly(state, air.step_s, air, state)
            t += air.step_s
            times.append(t)
            states.append(state.copy())
    return np.array(times), np.array(states)


@njit
def _continue_knots(knots_t: Array, knots: Array, index: NDArray[np.intp], t: Array, air: Air, states: Array) -> None:
    for i in range(len(t)):
        fly(knots[index[i]], t[i] - knots_t[index[i]], air, states[i])
