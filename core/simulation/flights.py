"""Ball paths as event cameras follow them: arcs under gravity, traced serves drawn from a seed, and series of serves on
one clock.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import check_settings, setting
from core.errors import ConfigError
from core.jit import njit
from core.physics.config import PhysicsConfig
from core.physics.contact import come_down
from core.physics.episode import Serves
from core.physics.flight import MAX_FLIGHT_S, Air, air_from_config, fall_through
from core.physics.task import ElevationConfig, TaskConfig
from core.simulation.episodes.closed_form import fly_serves
from core.simulation.episodes.episode_path import Trajectory, trace_episode
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class BallStates:
    """The ball at N times."""

    t_s: Array
    p_world_m: Array
    """(N, 3)"""
    v_world_mps: Array
    """(N, 3)"""
    spin_radps: Array
    """(N, 3), world axes."""
    present: NDArray[np.bool_]
    """False between flights, when there is no ball; position and velocity are nan then."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibleRange:
    """Where the ball comes out of nothing and goes into nothing: N half spaces that hide it.

    A point p of the ball can be seen where `normal_world @ p > offset_m`. A flight begins and ends at such a plane
    across its direction, as at the mouth of a launcher: the ball slides out of it, so that even the first event of a
    flight comes from an intensity that changes continuously.
    """

    normal_world: Array
    """(N, 3) unit vectors."""
    offset_m: Array
    """(N,)"""


class BallPath(Protocol):
    """Where the ball is at any time: a closed form, a recorded rally, or a physics engine's samples."""

    @property
    def end_s(self) -> float:
        """When the last flight is over."""
        ...

    @property
    def discontinuities_s(self) -> Array:
        """Ascending times at which velocity jumps or the ball appears or vanishes."""
        ...

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,)."""
        ...

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """What hides the ball at the times `t_s` (N,); offset -inf where nothing does."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ParabolicPath:
    """K arcs of one ball, from `start_s[0]` to `end_s`, under gravity alone."""

    start_s: Array
    """(K,) ascending start times of the arcs."""
    p_world_m: Array
    """(K, 3) position at the start of each arc."""
    v_world_mps: Array
    """(K, 3) velocity there, after the bounce."""
    spin_radps: Array
    """(K, 3) constant along an arc."""
    end_s: float
    gravity_mps2: float = GRAVITY_MPS2

    def __post_init__(self) -> None:
        if not len(self.start_s) or (np.diff(self.start_s) <= 0).any() or self.end_s <= self.start_s[-1]:
            raise ConfigError("the arcs of a flight are out of order", expected="ascending times", got=self.start_s)

    @property
    def discontinuities_s(self) -> Array:
        """Start, bounces and end."""
        return np.append(self.start_s, self.end_s)

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,); present from the start up to, not including, the end."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        (p, v, spin), present = np.empty((3, len(t), 3)), np.empty(len(t), np.bool_)
        arcs = self.start_s, self.p_world_m, self.v_world_mps, self.spin_radps
        _on_arcs(arcs, self.end_s, self.gravity_mps2, t, (p, v, spin), present)
        return BallStates(t, p, v, spin, present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """The launcher's mouth, and its like at the end."""
        return launcher_visible_range(self, float(self.start_s[0]), np.atleast_1d(np.asarray(t_s, np.float64)))


@njit(error_model="numpy")
def _on_arcs(arcs, end_s, gravity, t_s, found, present):
    (starts_s, ps, vs, spins), (p, v, spin) = arcs, found
    for index in range(len(t_s)):
        t = t_s[index]
        present[index] = starts_s[0] <= t < end_s
        if not present[index]:
            p[index] = v[index] = spin[index] = math.nan
            continue
        arc = np.searchsorted(starts_s, t, side="right") - 1
        since = t - starts_s[arc]
        for axis in range(3):
            p[index, axis] = ps[arc, axis] + vs[arc, axis] * since
            v[index, axis], spin[index, axis] = vs[arc, axis], spins[arc, axis]
        p[index, 2] -= 0.5 * gravity * (since * since)
        v[index, 2] -= gravity * since


def launcher_visible_range(path: BallPath, start_s: float, t_s: Array) -> VisibleRange:
    """For a flight from `start_s` to `path.end_s`: the plane at its nearer end, one ball radius off the centre there.

    At the very start the whole ball is behind it; it is out after it has flown its own diameter.
    """
    normal, offset = _portals_of(path, start_s)
    nearer = (t_s - start_s > path.end_s - t_s).astype(np.intp)
    return VisibleRange(normal[nearer], offset[nearer])


@functools.lru_cache(maxsize=16)
def _portals_of(path: BallPath, start_s: float) -> tuple[Array, Array]:
    """Normals (2, 3) and offsets (2,) of the planes at the start and at the end."""
    just_before_end = np.nextafter(path.end_s, -np.inf)
    ends = path.at([start_s, just_before_end])
    direction = ends.v_world_mps / np.linalg.norm(ends.v_world_mps, axis=1, keepdims=True)
    normal = direction * [[1.0], [-1.0]]
    return normal, np.einsum("ij,ij->i", normal, ends.p_world_m) + BALL_RADIUS_M


@dataclass(frozen=True, slots=True, eq=False)
class TracedFlight:
    """One ball on an integrated trajectory, from `start_s` to `end_s`; as smooth and exact as its integrator."""

    trajectory: Trajectory
    """Its time counts from the launch."""
    start_s: float
    end_s: float

    @property
    def discontinuities_s(self) -> Array:
        """Start, bounces and end."""
        times_s = np.array([self.start_s + event.t_s for event in self.trajectory.events])
        return np.append(times_s[times_s < self.end_s], self.end_s)

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,); present from the start up to, not including, the end."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        states = self.trajectory.at(t - self.start_s)
        present = (self.start_s <= t) & (t < self.end_s)
        states[~present] = np.nan
        return BallStates(t, states[:, :3], states[:, 3:6], states[:, 6:9], present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """The launcher's mouth, and its like at the end."""
        return launcher_visible_range(self, self.start_s, np.atleast_1d(np.asarray(t_s, np.float64)))


DRAWS_AT_MOST: Final = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchConfig:
    """How balls are launched: towards -x, so that they bounce once in the robot's half, and where they bounce.

    The launch elevation depends on the speed: low enough to bounce there, high enough to clear the net.
    """

    speed_mps: float = setting(5.0, 3.0, 9.0, step=0.5)
    """Launch speed; 3 to 9 m/s is the range of the curriculum (paper: 3, 4, 5)."""
    bounce_x_m: float = setting(-0.80, -1.2, -0.3)
    """Mean of where the ball bounces, about the middle of the robot's half."""
    bounce_spread_m: float = setting(0.15, 0.0, 0.4)
    """Half width of the uniform spread of the launch distance, and so of the bounce."""
    height_low_m: float = setting(0.28, 0.1, 1.0)
    """Launch height above the table, lowest."""
    height_high_m: float = setting(0.42, 0.1, 1.0)
    """Launch height above the table, highest."""
    side_spread_m: float = setting(0.35, 0.0, 0.7)
    """Half width of the uniform spread of the launch across the table."""
    yaw_spread_deg: float = setting(0.0, 0.0, 15.0)
    """Half width of the uniform spread of the direction; 0 flies along the table."""
    speed_spread: float = setting(0.0, 0.0, 0.3)
    """Half width of the uniform relative spread of the speed."""
    spin_spread_radps: float = setting(0.0, 0.0, 500.0)
    """Half width of the uniform spread of each spin component; 0 as in the paper."""
    exit_x_m: float = setting(-2.3, -6.0, -1.42)
    """The flight ends here, behind the hitting plane and out of sight of the cameras, or on the floor."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.height_low_m > self.height_high_m:
            got = f"{self.height_low_m} to {self.height_high_m}"
            raise ConfigError("launch heights are swapped", expected="low below high", got=got, where="ServeConfig")


def draw_serve(
    config: LaunchConfig, start_s: float, rng: np.random.Generator, physics: PhysicsConfig | None = None
) -> BallPath:
    """One serve that clears the net, bounces once, on the robot's half, and reaches the hitting plane.

    `physics` is that of the paper unless told otherwise; the same seed launches alike in both, as long as no draw is
    refused.

    Args:
        config: speed, height, elevation and how they spread.
        start_s: time of the launch.
        rng: source of random numbers.
        physics: None: the paper's.

    Raises:
        ConfigError: if the config allows no such serve (1,000 draws failed).
    """
    task = TaskConfig(physics=physics or PhysicsConfig())
    for _ in range(DRAWS_AT_MOST):
        launch = _draw_launch(config, rng, air_from_config(task.physics))
        if fly_serves(launch, task).legal[0]:
            return serve_flight(launch, start_s, task.physics, exit_x_m=config.exit_x_m)
    raise ConfigError("no serve clears the net and bounces in the robot's half", got=config, where="ServeConfig")


def serve_flight(launch: Serves, start_s: float, physics: PhysicsConfig, *, exit_x_m: float = -2.3) -> BallPath:
    """The flight of one launch (arrays of one row) to `exit_x_m` or the floor, bouncing wherever it meets the table.

    Args:
        launch: one launch.
        start_s: its time.
        physics: of the flight.
        exit_x_m: where the flight ends.

    Raises:
        ConfigError: if there is not exactly one launch.
    """
    trajectory = trace_episode(launch, None, TaskConfig(physics=physics), duration_s=MAX_FLIGHT_S)
    end_s = min(trajectory.end_s, _exit_s(trajectory, exit_x_m))
    if physics.has_air:
        return TracedFlight(trajectory, start_s, start_s + end_s)
    arcs = [event for event in trajectory.events if event.t_s < end_s]
    states = np.array([arc.state for arc in arcs])
    starts_s = start_s + np.array([arc.t_s for arc in arcs])
    return ParabolicPath(starts_s, states[:, :3], states[:, 3:6], states[:, 6:9], start_s + end_s)


def _draw_launch(config: LaunchConfig, rng: np.random.Generator, air: Air) -> Serves:
    speed = config.speed_mps * (1.0 + config.speed_spread * rng.uniform(-1, 1))
    elevation = ElevationConfig().at(speed)
    yaw = math.radians(config.yaw_spread_deg * rng.uniform(-1, 1))
    height = rng.uniform(config.height_low_m, config.height_high_m)
    side = config.side_spread_m * rng.uniform(-1, 1)
    forward = speed * math.cos(elevation)
    state = np.zeros(9)
    state[:3] = (0.0, side, height)
    state[3:6] = (-forward * math.cos(yaw), forward * math.sin(yaw), speed * math.sin(elevation))
    shift = config.bounce_spread_m * rng.uniform(-1, 1)
    if config.spin_spread_radps:
        state[6:9] = config.spin_spread_radps * rng.uniform(-1, 1, 3)
    bounce = np.empty(9)
    come_down(state, air, bounce)
    state[0] = config.bounce_x_m - bounce[0] + shift
    return Serves(state[None, :3], state[None, 3:6], state[None, 6:9])


def _exit_s(trajectory: Trajectory, exit_x_m: float) -> float:
    """When the ball flies out through the plane at `exit_x_m`; infinity if it does not."""
    out = np.empty(9)
    arcs = trajectory.events
    ends_s = [arc.t_s for arc in arcs[1:]] + [trajectory.end_s]
    for arc, end_s in zip(arcs, ends_s, strict=True):
        exit_s = arc.t_s + fall_through(arc.state, (1.0, 0.0, 0.0, 0.0, -exit_x_m), trajectory.air, out)
        if exit_s <= end_s:
            return exit_s
    return math.inf


FIRST_SERVE_S = 0.05
"""Quiet before the first ball."""
PAUSE_S = 0.08
"""Quiet between one flight's end and the next serve."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightSeries:
    """Flights one after the other, never two at once."""

    flights: tuple[BallPath, ...]
    """Each begins at its first kink."""
    discontinuities_s: Array = field(init=False)
    """Starts, bounces and ends of all flights."""
    _starts_s: Array = field(init=False)
    _ends_s: Array = field(init=False)

    def __post_init__(self) -> None:
        discontinuities_s = [flight.discontinuities_s for flight in self.flights]
        starts_s = np.array([times_s[0] for times_s in discontinuities_s])
        ends_s = np.array([flight.end_s for flight in self.flights])
        if (starts_s[1:] < ends_s[:-1]).any():
            first = int(np.argmax(starts_s[1:] < ends_s[:-1]))
            raise ConfigError("two flights overlap", got=f"{starts_s[first + 1]} s before {ends_s[first]} s")
        object.__setattr__(self, "discontinuities_s", np.concatenate([np.empty(0), *discontinuities_s]))
        object.__setattr__(self, "_starts_s", starts_s)
        object.__setattr__(self, "_ends_s", ends_s)

    @property
    def end_s(self) -> float:
        """End of the last flight; 0 without any."""
        return self.flights[-1].end_s if self.flights else 0.0

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        touching = self._touching(t)
        if len(touching) == 1:
            return self.flights[touching[0]].at(t)
        p, v, spin = np.full((3, len(t), 3), np.nan)
        present = np.zeros(len(t), np.bool_)
        for which in touching:
            states = self.flights[which].at(t)
            inside = states.present
            p[inside], v[inside] = states.p_world_m[inside], states.v_world_mps[inside]
            spin[inside] = states.spin_radps[inside]
            present |= inside
        return BallStates(t, p, v, spin, present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """What hides the ball at the times `t_s` (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        normal, offset = np.zeros((len(t), 3)), np.full(len(t), -np.inf)
        for which in self._touching(t):
            inside = (self._starts_s[which] <= t) & (t < self._ends_s[which])
            visible_range = self.flights[which].visible_range(t[inside])
            if inside.all():
                return visible_range
            normal[inside], offset[inside] = visible_range.normal_world, visible_range.offset_m
        return VisibleRange(normal, offset)

    def _touching(self, t: Array) -> range:
        """Numbers of the few flights that a stretch of time meets: to ask each would take long in a long recording."""
        if not len(t):
            return range(0)
        first = int(np.searchsorted(self._ends_s, t.min(), side="right"))
        return range(first, int(np.searchsorted(self._starts_s, t.max(), side="right")))


def draw_serve_series(
    configs: Sequence[LaunchConfig], rng: np.random.Generator, physics: PhysicsConfig | None = None
) -> FlightSeries:
    """One serve per config, with short pauses between; in the paper's physics unless told otherwise.

    Raises:
        ConfigError: if a config allows no serve.
    """
    flights: list[BallPath] = []
    start_s = FIRST_SERVE_S
    for config in configs:
        flights.append(draw_serve(config, start_s, rng, physics))
        start_s = flights[-1].end_s + PAUSE_S
    return FlightSeries(tuple(flights))
