"""Where a ball is that bounces on the table, against the school's formulas and against small steps."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from core.physics.config import PhysicsConfig, TableImpactConfig, physics_profile
from core.physics.fit_flights import positions_at
from core.physics.flight import Air, air_from_config, fly
from core.physics.impact import Surface, surfaces_from_config

pytestmark = pytest.mark.numeric
Array = NDArray[np.float64]

G = 9.81
RADIUS_M = 0.02
GRAVITY_ONLY = air_from_config(physics_profile("paper"))
SMOOTH = surfaces_from_config(
    PhysicsConfig(table=TableImpactConfig(restitution=0.8, restitution_loss_s_per_m=0.0, friction=0.0))
)[0]


def path(start: Sequence[float], t_s: Sequence[float], air: Air = GRAVITY_ONLY, table: Surface = SMOOTH) -> Array:
    ps = np.full((len(t_s), 3), np.nan)
    positions_at(np.array([*start, 0.0, 0.0, 0.0]), np.array(t_s), air, table, ps)
    return ps


def test_a_dropped_ball_hops_as_the_school_says() -> None:
    """From rest, a height h above the table: it lands at sqrt(2h/g), and each hop has 0.8 of the speed before."""
    height = 0.3
    first = math.sqrt(2 * height / G)
    speed = G * first
    second = first + 2 * 0.8 * speed / G
    third = second + 2 * 0.64 * speed / G
    times = [0.0, 0.1, first, first + 0.8 * speed / G, second, second + 0.64 * speed / G, third + 0.1]
    heights = [height, height - G / 2 * 0.01, 0, 0.64 * height, 0, 0.4096 * height]
    heights.append(0.512 * speed * 0.1 - G / 2 * 0.01)
    ps = path([0.3, -0.2, RADIUS_M + height, 0.5, 0.25, 0.0], times)
    np.testing.assert_allclose(ps[:, 2] - RADIUS_M, heights, atol=1e-9)
    np.testing.assert_allclose(ps[:, 0], 0.3 + 0.5 * np.array(times), atol=1e-12)
    np.testing.assert_allclose(ps[:, 1], -0.2 + 0.25 * np.array(times), atol=1e-12)


def test_a_ball_that_comes_down_beside_the_table_falls_on() -> None:
    for y, vy in ((0.9, 0.0), (0.7, 2.0)):  # beside it from the start, and out over the side line
        assert path([0.3, y, 0.08, 0.0, vy, 0.0], [0.6])[0, 2] == pytest.approx(0.08 - G / 2 * 0.36)


def test_a_ball_that_hops_off_the_table_falls_on() -> None:
    down = math.sqrt(2 * 0.06 / G)
    hop = 2 * 0.8 * down
    assert 0.7 + 0.3 * down < 0.7625 < 0.7 + 0.3 * (down + hop), "its second landing is outside"
    after = 0.6 - down
    ps = path([0.3, 0.7, 0.08, 0.0, 0.3, 0.0], [0.6])
    assert ps[0, 2] == pytest.approx(RADIUS_M + 0.8 * G * down * after - G / 2 * after * after)
    assert ps[0, 2] < 0


def test_the_places_do_not_depend_on_which_times_are_asked_for() -> None:
    air = air_from_config(physics_profile("real"))
    table = surfaces_from_config(physics_profile("real"))[0]
    start = [1.2, 0.1, 0.3, -4.0, 0.2, 1.0]
    many = path(start, np.arange(0, 0.9, 0.007).tolist(), air, table)
    few = path(start, [0.007 * 40, 0.007 * 100], air, table)
    np.testing.assert_allclose(few, many[[40, 100]], atol=1e-8)


def test_with_air_it_is_the_flight_of_small_steps() -> None:
    air = air_from_config(physics_profile("real"))
    now = np.array([1.0, 0.2, 0.5, -5.0, 0.3, 1.0, 0.0, 0.0, 0.0])
    start = now[:6].tolist()
    for _ in range(400):
        fly(now, 0.001 / 2, air, now)
    np.testing.assert_allclose(path(start, [0.2], air)[0], now[:3], atol=1e-9)
