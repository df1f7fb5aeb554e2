"""Serves: seeded draws of a launch towards the robot, and the flight that follows."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.errors import ConfigError
from core.simulation.bounce import BounceConfig, bounce_on_table
from core.simulation.flight import Flight
from core.table import BALL_RADIUS_M, GRAVITY_MPS2, NET_HEIGHT_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

ELEVATION_SPEEDS_MPS: Final = (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
ELEVATIONS_DEG: Final = (25.0, 18.0, 12.0, 7.0, 3.0, 1.0, 0.0)
"""Launch elevation at each speed: low enough to bounce in the robot's half, high enough to clear the net."""
DRAWS_AT_MOST: Final = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeConfig:
    """How balls are launched: towards -x, without spin, so that they bounce once in the robot's half."""

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
    exit_x_m: float = setting(-2.3, -6.0, -1.42)
    """The flight ends here, behind the hitting plane and out of sight of the cameras, or on the floor."""
    bounce: BounceConfig = field(default_factory=BounceConfig)

    def __post_init__(self) -> None:
        check_settings(self)
        if self.height_low_m > self.height_high_m:
            got = f"{self.height_low_m} to {self.height_high_m}"
            raise ConfigError("launch heights are swapped", expected="low below high", got=got, where="ServeConfig")


def draw_serve(config: ServeConfig, start_s: float, rng: np.random.Generator) -> Flight:
    """One serve that clears the net and bounces once, on the robot's half.

    Raises:
        ConfigError: if the config allows no such serve (1,000 draws failed).
    """
    for _ in range(DRAWS_AT_MOST):
        p, v = _draw_launch(config, rng)
        if _clears_net(p, v):
            flight = serve_flight(p, v, start_s, config)
            if _bounces_once_on_robot_half(flight):
                return flight
    raise ConfigError("no serve clears the net and bounces in the robot's half", got=config, where="ServeConfig")


def serve_flight(p_world_m: Array, v_world_mps: Array, start_s: float, config: ServeConfig) -> Flight:
    """The flight from a launch to `exit_x_m` or the floor, bouncing on the table as long as it comes down on it."""
    starts, ps, vs = [start_s], [np.array(p_world_m, np.float64)], [np.array(v_world_mps, np.float64)]
    spins = [np.zeros(3)]
    while True:
        p, v = ps[-1], vs[-1]
        leaves_s = min(_fall_time(p, v, BALL_RADIUS_M - TABLE_HEIGHT_M), _exit_time(p, v, config.exit_x_m))
        lands_s = _fall_time(p, v, BALL_RADIUS_M)
        landing = p + v * lands_s
        on_table = abs(landing[0]) <= TABLE_LENGTH_M / 2 and abs(landing[1]) <= TABLE_WIDTH_M / 2
        if not on_table or lands_s >= leaves_s or p[2] < BALL_RADIUS_M - 1e-9:
            end_s = starts[-1] + leaves_s
            return Flight(np.array(starts), np.array(ps), np.array(vs), np.array(spins), end_s)
        landing[2] = BALL_RADIUS_M
        v_down = v - [0.0, 0.0, GRAVITY_MPS2 * lands_s]
        v_after, spin_after = bounce_on_table(v_down, spins[-1], config.bounce)
        starts.append(starts[-1] + lands_s)
        ps.append(landing)
        vs.append(v_after)
        spins.append(spin_after)


def _draw_launch(config: ServeConfig, rng: np.random.Generator) -> tuple[Array, Array]:
    speed = config.speed_mps * (1.0 + config.speed_spread * rng.uniform(-1, 1))
    elevation = np.radians(np.interp(speed, ELEVATION_SPEEDS_MPS, ELEVATIONS_DEG))
    yaw = np.radians(config.yaw_spread_deg * rng.uniform(-1, 1))
    height = rng.uniform(config.height_low_m, config.height_high_m)
    side = config.side_spread_m * rng.uniform(-1, 1)
    forward = speed * np.cos(elevation)
    v = np.array([-forward * np.cos(yaw), forward * np.sin(yaw), speed * np.sin(elevation)])
    p = np.array([0.0, side, height])
    p[0] = config.bounce_x_m - v[0] * _fall_time(p, v, BALL_RADIUS_M) + config.bounce_spread_m * rng.uniform(-1, 1)
    return p, v


def _clears_net(p: Array, v: Array) -> bool:
    if p[0] <= 0:
        return True
    t = -p[0] / v[0]
    return bool(p[2] + v[2] * t - 0.5 * GRAVITY_MPS2 * t**2 > NET_HEIGHT_M + BALL_RADIUS_M)


def _bounces_once_on_robot_half(flight: Flight) -> bool:
    bounces = flight.p_world_m[1:]
    return len(bounces) == 1 and bool(bounces[0, 0] < 0)


def _fall_time(p: Array, v: Array, z_m: float) -> float:
    """Seconds until the ball comes down through height z; 0 if it is below already and will not rise above it."""
    square = v[2] ** 2 + 2 * GRAVITY_MPS2 * (p[2] - z_m)
    return float((v[2] + np.sqrt(square)) / GRAVITY_MPS2) if square > 0 else 0.0


def _exit_time(p: Array, v: Array, exit_x_m: float) -> float:
    return float((exit_x_m - p[0]) / v[0]) if v[0] < 0 else float("inf")
