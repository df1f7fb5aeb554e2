"""Laws of the rigid impact: what a hollow ball may and may not do on a surface."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from core.physics.config import physics_profile
from core.physics.impact import Surface, strike, surfaces_from_config
from core.table import BALL_MASS_KG, BALL_RADIUS_M

pytestmark = pytest.mark.numeric
Array = NDArray[np.float64]

PAPER_TABLE, PAPER_RUBBER = surfaces_from_config(physics_profile("paper"))
REAL_TABLE, REAL_RUBBER = surfaces_from_config(physics_profile("real"))
SURFACES = {
    "paper table": PAPER_TABLE,
    "paper rubber": PAPER_RUBBER,
    "real table": REAL_TABLE,
    "real rubber": REAL_RUBBER,
}
UP = (0.0, 0.0, 1.0)
STILL = (0.0, 0.0, 0.0)


def random_states(count: int) -> Array:
    rng = np.random.default_rng(7)
    states = np.zeros((count, 9))
    states[:, 3:5] = rng.uniform(-10, 10, (count, 2))
    states[:, 5] = rng.uniform(-8, -0.1, count)
    states[:, 6:9] = rng.uniform(-300, 300, (count, 3))
    return states


def struck(state: Array, surface: Surface, normal: tuple[float, float, float] = UP) -> Array:
    after = state.copy()
    strike(after, normal, STILL, surface)
    return after


def energy(state: Array) -> float:
    inertia = 2 / 3 * BALL_MASS_KG * BALL_RADIUS_M**2
    return 0.5 * BALL_MASS_KG * state[3:6] @ state[3:6] + 0.5 * inertia * state[6:9] @ state[6:9]


def contact_velocity(state: Array, normal: Array) -> Array:
    return state[3:6] + np.cross(state[6:9], -BALL_RADIUS_M * normal)


@pytest.mark.parametrize("name", SURFACES)
def test_an_impact_never_adds_energy(name: str) -> None:
    for state in random_states(500):
        assert energy(struck(state, SURFACES[name])) <= energy(state) + 1e-15


@pytest.mark.parametrize("name", SURFACES)
def test_the_impulse_stays_in_the_friction_cone(name: str) -> None:
    surface = SURFACES[name]
    for state in random_states(500):
        impulse = struck(state, surface)[3:6] - state[3:6]
        assert math.hypot(impulse[0], impulse[1]) <= surface.friction * impulse[2] * (1 + 1e-12)


@pytest.mark.parametrize("name", SURFACES)
def test_the_spin_changes_by_the_moment_of_the_impulse(name: str) -> None:
    surface = SURFACES[name]
    inertia = 2 / 3 * BALL_MASS_KG * BALL_RADIUS_M**2
    for state in random_states(100):
        after = struck(state, surface)
        moment = np.cross([0, 0, -BALL_RADIUS_M], BALL_MASS_KG * (after[3:6] - state[3:6]))
        expected = state[6:9] + moment / inertia
        expected[2] = state[8] * surface.spin_retention
        assert after[6:9] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_ball_that_grips_a_sticking_surface_leaves_with_its_contact_point_at_rest() -> None:
    state = np.array([0, 0, 0, 1.0, -0.5, -4.0, 5.0, 8.0, 0.0])
    after = struck(state, PAPER_RUBBER)
    assert contact_velocity(after, np.array(UP))[:2] == pytest.approx([0, 0], abs=1e-12)


def test_a_kicking_rubber_throws_the_contact_point_back() -> None:
    state = np.array([0, 0, 0, 2.0, 0, -5.0, 0, 0, 0])
    after = struck(state, REAL_RUBBER)
    assert contact_velocity(after, np.array(UP))[0] == pytest.approx(-(0.819 - 0.010 * 2.0) * 2.0)
    assert after[5] == pytest.approx((0.878 - 0.020 * 5.0) * 5.0)


def test_a_sliding_bounce_loses_friction_times_the_normal_impulse() -> None:
    after = struck(np.array([0, 0, 0, -8.0, 0, -2.0, 0, 0, 0]), PAPER_TABLE)
    assert after[3] == pytest.approx(-8.0 + 0.15 * 1.9 * 2.0)
    assert after[5] == pytest.approx(1.8)
    # The lower side is held back, so the ball gets topspin: for a ball that flies to -x that is a negative y spin.
    assert after[7] == pytest.approx(-1.5 / 0.02 * 0.15 * 1.9 * 2.0)


def test_topspin_makes_the_bounce_faster_until_friction_is_at_its_limit() -> None:
    spins = (-400.0, -150.0, 0.0, 400.0)
    speeds = [struck(np.array([0, 0, 0, -5.0, 0, -3.0, 0, spin, 0]), REAL_TABLE)[3] for spin in spins]
    assert speeds[0] < -5.0 < speeds[1] < speeds[2] < 0
    assert speeds[2] == speeds[3] == pytest.approx(-5.0 + 0.227 * 1.945 * 3.0)


def test_mirroring_in_y_mirrors_the_bounce() -> None:
    mirror = np.array([1, -1, 1, 1, -1, 1, -1, 1, -1.0])
    for state in random_states(50):
        assert struck(state * mirror, REAL_RUBBER) == pytest.approx(struck(state, REAL_RUBBER) * mirror)


def test_turning_the_world_turns_the_bounce() -> None:
    # x -> z -> -x: a quarter turn about -y that takes the normal from z to -x.
    turn = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    for state in random_states(50):
        turned = np.concatenate([turn @ state[k : k + 3] for k in (0, 3, 6)])
        found, expected = struck(turned, REAL_RUBBER, (-1.0, 0.0, 0.0)), struck(state, REAL_RUBBER)
        assert found[3:6] == pytest.approx(turn @ expected[3:6])
        assert found[6:9] == pytest.approx(turn @ expected[6:9])


def test_only_the_velocity_relative_to_a_moving_wall_matters() -> None:
    wall = np.array([1.0, -2.0, 0.5])
    for state in random_states(50):
        moving = state.copy()
        moving[3:6] += wall
        strike(moving, UP, (1.0, -2.0, 0.5), REAL_RUBBER)
        assert moving[3:6] - wall == pytest.approx(struck(state, REAL_RUBBER)[3:6])


def test_a_ball_that_leaves_the_surface_is_not_touched() -> None:
    state = np.array([0, 0, 0, 3.0, 1.0, 0.5, 10.0, 20.0, 30.0])
    assert (struck(state, REAL_RUBBER) == state).all()
