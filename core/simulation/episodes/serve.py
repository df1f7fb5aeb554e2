"""Seeded serves: a launcher on the opponent's side sends the ball over the net, one bounce, to the hitting plane."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.physics.episode import Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import fly_serves
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]

MAX_ROUNDS = 200
"""Most rounds of drawing again; a distribution without a legal serve by then has practically none."""


def draw_serves(speed_mps: float, count: int, config: TaskConfig, rng: np.random.Generator) -> Serves:
    """`count` serves of one speed, 3 to 9 m/s.

    Raises:
        ConfigError: if the speed is out of range, or the distribution has (nearly) no legal serve.
    """
    if not 3.0 <= speed_mps <= 9.0:
        raise ConfigError("no serve of this speed", expected="3 to 9 m/s", got=speed_mps, where="draw_serves")
    if not config.serve.only_legal:
        return _draw(speed_mps, count, config, rng)
    found: list[Serves] = []
    missing = count
    for _ in range(MAX_ROUNDS):
        if missing <= 0:
            break
        drawn = _draw(speed_mps, max(16, 2 * missing), config, rng)
        legal = drawn[fly_serves(drawn, config).legal][:missing]
        found.append(legal)
        missing -= len(legal)
    if missing > 0:
        raise ConfigError(
            "the serve distribution has no legal serves",
            got=f"{count - missing} of {count} after {MAX_ROUNDS} rounds at {speed_mps:g} m/s",
            remedy="change the elevation, the height or the bounce position, or set only_legal to false",
        )
    return Serves(
        *(np.concatenate(parts) for parts in zip(*((s.ps_m, s.vs_mps, s.spins_radps) for s in found), strict=True))
    )


def _draw(speed_mps: float, count: int, config: TaskConfig, rng: np.random.Generator) -> Serves:
    serve = config.serve
    z = rng.uniform(serve.height_low_m, serve.height_high_m, count)
    y = rng.uniform(-1, 1, count) * serve.lateral_spread_m
    shift = rng.uniform(-1, 1, count) * serve.bounce_spread_m
    y_hit = rng.uniform(-1, 1, count) * serve.lateral_spread_m if serve.aim_lateral else y
    elevation = serve.elevation.at(speed_mps) + math.radians(serve.elevation_spread_deg) * rng.uniform(-1, 1, count)
    speed = speed_mps * (1 + serve.speed_spread * rng.uniform(-1, 1, count))
    spin = serve.spin_spread_radps * rng.uniform(-1, 1, (count, 3))
    x = serve.bounce_x_m + _flight_distance(speed_mps, config) + shift
    yaw = np.arctan2(y_hit - y, x - config.stroke.hit_plane_x_m)
    velocity = speed[:, None] * np.column_stack(
        [-np.cos(elevation) * np.cos(yaw), np.cos(elevation) * np.sin(yaw), np.sin(elevation)]
    )
    return Serves(np.column_stack([x, y, z]), velocity, spin)


def _flight_distance(speed_mps: float, config: TaskConfig) -> float:
    """How far the mean serve flies along x until it bounces, by gravity alone."""
    elevation = config.serve.elevation.at(speed_mps)
    drop = (config.serve.height_low_m + config.serve.height_high_m) / 2 - BALL_RADIUS_M
    vz = speed_mps * math.sin(elevation)
    return speed_mps * math.cos(elevation) * (vz + math.sqrt(vz * vz + 2 * GRAVITY_MPS2 * drop)) / GRAVITY_MPS2
