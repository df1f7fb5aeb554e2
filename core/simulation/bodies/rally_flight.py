"""A rally of two players as one flight: every ball bounces once in the other half and is met by a racket there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.physics.config import PhysicsConfig
from core.physics.episode import Serves
from core.simulation.bodies.actors import PlayerStroke
from core.simulation.flights import (
    DRAWS_AT_MOST,
    FIRST_SERVE_S,
    PAUSE_S,
    FlightSeries,
    LaunchConfig,
    ParabolicPath,
    draw_serve_series,
    serve_flight,
)
from core.simulation.scenes.scene import SceneConfig
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]

STROKES: Final = 5
"""Number of strokes of a rally; odd, so that the last ball leaves at the robot's end, where a serve's flight ends
too."""
CONTACT_X_M: Final = 1.55
"""Distance from the net at which the players meet the ball (choice: just behind the table)."""
REACH_M: Final = ((0.10, 0.55), 0.65)
"""Heights, and distance from the middle, at which a player meets it."""
BETWEEN_RALLIES_S: Final = 1.2
"""Pause between two rallies, in which the players get ready."""
HALF_TURN: Final = np.array([-1.0, -1.0, 1.0])
"""The other player's view: x and y change their signs."""


def draw_flights(
    scene: SceneConfig, serves: Sequence[LaunchConfig], rng: np.random.Generator, physics: PhysicsConfig | None = None
) -> tuple[FlightSeries, tuple[PlayerStroke, ...]]:
    """The balls of a scene, one after the other, and the players' strokes: a serve each, or a rally each in `rally`.

    Raises:
        ConfigError: if a config allows no such ball, or for a rally in physics with air.
    """
    if scene.cast != "rally":
        return draw_serve_series(serves, rng, physics), ()
    physics = physics or PhysicsConfig()
    if physics.has_air:
        raise ConfigError("a rally of two players flies without air", expected="physics paper", where="scene rally")
    flights: list[ParabolicPath] = []
    strokes: list[PlayerStroke] = []
    start_s = FIRST_SERVE_S + BETWEEN_RALLIES_S
    for config in serves:
        flight, played = draw_rally(config, start_s, rng, physics)
        flights.append(flight)
        strokes += played
        start_s = flight.end_s + PAUSE_S + BETWEEN_RALLIES_S
    return FlightSeries(tuple(flights)), tuple(strokes)


def draw_rally(
    config: LaunchConfig, start_s: float, rng: np.random.Generator, physics: PhysicsConfig
) -> tuple[ParabolicPath, list[PlayerStroke]]:
    """`STROKES` strokes, the first by the player at +x, with `config.speed_mps` along the table.

    Args:
        config: speed and where the ball goes.
        start_s: time of the first stroke.
        rng: source of random numbers.
        physics: of the flight.

    Raises:
        ConfigError: if no such ball was found in 1,000 draws.
    """
    p = np.array([CONTACT_X_M, rng.uniform(-0.4, 0.4), rng.uniform(0.2, 0.4)])
    v_before, t_s = np.zeros(3), start_s
    starts_s, ps, vs, spins, strokes = [], [], [], [], []
    for index in range(STROKES):
        last, turn = index == STROKES - 1, HALF_TURN if index % 2 else np.ones(3)
        leg = _draw_leg(p * turn, config.speed_mps, config.exit_x_m if last else -CONTACT_X_M, rng, physics)
        starts_s += list(t_s + leg.start_s)
        ps += list(leg.p_world_m * turn)
        vs += list(leg.v_world_mps * turn)
        spins += list(leg.spin_radps * [turn[0], turn[1], 1.0])
        push = vs[-2] - v_before
        normal = push / np.linalg.norm(push)
        strokes.append(PlayerStroke(t_s, p - BALL_RADIUS_M * normal, normal))
        met = leg.at([np.nextafter(leg.end_s, 0.0)])
        p, v_before, t_s = met.p_world_m[0] * turn, met.v_world_mps[0] * turn, t_s + leg.end_s
    return ParabolicPath(np.array(starts_s), np.array(ps), np.array(vs), np.array(spins), t_s), strokes


def _draw_leg(
    p: Array, speed_mps: float, exit_x_m: float, rng: np.random.Generator, physics: PhysicsConfig
) -> ParabolicPath:
    """From a contact at +x over the net, one bounce, to `exit_x_m`, where the other player can meet it."""
    (lowest_m, highest_m), side_m = REACH_M
    for _ in range(DRAWS_AT_MOST):
        way = np.array([rng.uniform(-1.15, -0.65), rng.uniform(-0.45, 0.45)]) - p[:2]
        along = speed_mps * rng.uniform(0.85, 1.1)
        fall_s = float(np.linalg.norm(way)) / along
        up = (BALL_RADIUS_M - p[2]) / fall_s + 0.5 * GRAVITY_MPS2 * fall_s
        v = np.array([*(way / fall_s), up])
        launch = Serves(p[None], v[None], np.zeros((1, 3)))
        leg = serve_flight(launch, 0.0, physics, exit_x_m=exit_x_m)
        assert isinstance(leg, ParabolicPath)
        met = leg.at([np.nextafter(leg.end_s, 0.0)]).p_world_m[0]
        bounced = len(leg.start_s) == 2 and leg.p_world_m[1, 0] < 0 and leg.p_world_m[1, 2] < 1.1 * BALL_RADIUS_M
        if (
            bounced
            and abs(met[0] - exit_x_m) < 1e-3
            and (exit_x_m != -CONTACT_X_M or (lowest_m < met[2] < highest_m and abs(met[1]) < side_m))
        ):
            return leg
    raise ConfigError("no ball of a rally can be played at this speed", got=speed_mps, where="scene rally")
