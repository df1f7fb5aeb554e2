"""Serves: seeded draws of a launch towards the robot, and the flight that follows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import check_settings, setting
from core.errors import ConfigError
from core.physics.config import PhysicsConfig
from core.physics.contact import come_down
from core.physics.episode import Serves
from core.physics.flight import MAX_FLIGHT_S, Air, air_from_config, fall_through
from core.physics.task import ElevationConfig, TaskConfig
from core.simulation.episodes.closed_form import fly_serves
from core.simulation.episodes.episode_path import Trajectory, trace_episode
from core.simulation.flights.ball_path import BallPath, BallStates, ParabolicPath, VisibleRange, launcher_visible_range

Array = NDArray[np.float64]


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
