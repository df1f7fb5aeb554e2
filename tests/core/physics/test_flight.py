"""Free flight: closed form, integrator, the conventions of drag and Magnus coefficients, and crossings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from core.physics.config import AirConfig, PhysicsConfig, physics_profile
from core.physics.flight import Air, air_from_config, fall_through, fly
from core.table import BALL_MASS_KG, BALL_RADIUS_M, GRAVITY_MPS2

pytestmark = pytest.mark.numeric
Array = NDArray[np.float64]

GRAVITY_ONLY = air_from_config(physics_profile("paper"))
REAL = air_from_config(physics_profile("real"))
LAUNCH = np.array([1.0, 0.2, 0.3, -6.0, 0.5, 2.0, 20.0, -200.0, 60.0])


def flown(state: Array, duration_s: float, steps: int, air: Air) -> Array:
    out = state.copy()
    for _ in range(steps):
        fly(out, duration_s / steps, air, out)
    return out


def test_gravity_alone_is_the_school_parabola() -> None:
    out = flown(LAUNCH, 0.5, 1, GRAVITY_ONLY)
    assert out[:3] == pytest.approx([1.0 - 3.0, 0.2 + 0.25, 0.3 + 1.0 - 0.5 * 9.81 * 0.25])
    assert out[3:6] == pytest.approx([-6.0, 0.5, 2.0 - 9.81 * 0.5])
    assert (out[6:] == LAUNCH[6:]).all()


def test_a_parabola_flown_backwards_comes_home() -> None:
    there = flown(LAUNCH, 0.7, 1, GRAVITY_ONLY)
    there[3:6] *= -1
    back = flown(there, 0.7, 7, GRAVITY_ONLY)
    assert back[:3] == pytest.approx(LAUNCH[:3], abs=1e-12)
    assert back[3:6] == pytest.approx(-LAUNCH[3:6], abs=1e-12)


def test_a_step_back_undoes_a_step_of_the_real_flight() -> None:
    there = flown(LAUNCH, 0.2, 50, REAL)
    back = flown(there, -0.2, 50, REAL)
    assert back == pytest.approx(LAUNCH, abs=1e-8)


def test_the_integrator_is_of_fourth_order() -> None:
    exact = flown(LAUNCH, 0.64, 2048, REAL)
    errors = [np.linalg.norm(flown(LAUNCH, 0.64, steps, REAL)[:3] - exact[:3]) for steps in (4, 8, 16)]
    assert 12 < errors[0] / errors[1] < 20
    assert 12 < errors[1] / errors[2] < 20


def test_the_default_step_is_good_to_a_micrometre() -> None:
    exact = flown(LAUNCH, 0.6, 6000, REAL)
    assert flown(LAUNCH, 0.6, 150, REAL)[:3] == pytest.approx(exact[:3], abs=1e-6)


def test_the_drag_coefficient_is_the_aerodynamic_one() -> None:
    # 3.8e-4 kg/m is k in m a = -k v^2 as published for this ball; it corresponds to C_d 0.50.
    k = 3.8e-4
    coefficient = k / (0.5 * 1.204 * math.pi * BALL_RADIUS_M**2)
    air = air_from_config(PhysicsConfig(air=AirConfig(drag_coefficient=coefficient)))
    assert coefficient == pytest.approx(0.50, abs=0.005)
    assert air.drag_per_m == pytest.approx(k / BALL_MASS_KG)
    slow_down = (flown(LAUNCH, 1e-6, 1, air)[3:6] - LAUNCH[3:6]) / 1e-6 + [0, 0, GRAVITY_MPS2]
    speed = np.linalg.norm(LAUNCH[3:6])
    assert slow_down == pytest.approx(-k / BALL_MASS_KG * speed * LAUNCH[3:6], rel=1e-4)


def test_the_magnus_coefficient_is_on_the_ball_s_volume() -> None:
    # 3.0e-6 kg is k in m a = k (spin x v) as published for this ball; it corresponds to C_M 0.074.
    volume = 4 / 3 * math.pi * BALL_RADIUS_M**3
    coefficient = 3.0e-6 / (1.204 * volume)
    air = air_from_config(PhysicsConfig(air=AirConfig(magnus_coefficient=coefficient)))
    assert coefficient == pytest.approx(0.074, abs=0.001)
    push = (flown(LAUNCH, 1e-6, 1, air)[3:6] - LAUNCH[3:6]) / 1e-6 + [0, 0, GRAVITY_MPS2]
    assert push == pytest.approx(3.0e-6 / BALL_MASS_KG * np.cross(LAUNCH[6:], LAUNCH[3:6]), rel=1e-4)


def test_topspin_pulls_the_ball_down() -> None:
    towards_robot = np.array([1.0, 0, 0.3, -6.0, 0, 1.0, 0, 0, 0])
    topspin = towards_robot.copy()
    topspin[7] = -200.0
    assert flown(topspin, 0.3, 60, REAL)[2] < flown(towards_robot, 0.3, 60, REAL)[2] - 0.02


def test_a_ball_that_is_in_the_air_for_longer_than_three_seconds_is_not_followed() -> None:
    table = (0.0, 0.0, 1.0, 0.0, -BALL_RADIUS_M)
    thrown = [np.array([0, 0, 0.3, 0, 0, up_mps, 0, 0, 0]) for up_mps in (20.0, 60.0)]
    times_s = [fall_through(state, table, REAL, np.empty(9)) for state in thrown]
    assert 2 < times_s[0] < 3 and math.isnan(times_s[1])


@pytest.mark.parametrize("air", [GRAVITY_ONLY, REAL], ids=["gravity", "real"])
def test_a_fall_through_a_moving_tilted_plane_is_on_the_plane_and_the_first_one(air: Air) -> None:
    rng = np.random.default_rng(3)
    found = 0
    for _ in range(60):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        plane = (*map(float, normal), float(rng.normal()), float(rng.uniform(0, 1)))
        state = LAUNCH + np.concatenate([rng.normal(0, 0.3, 3), rng.normal(0, 2, 3), np.zeros(3)])
        out = np.empty(9)
        t = fall_through(state, plane, air, out)
        times = np.arange(0, 0.6, 0.004)
        path = np.array([state[:3]] * len(times))
        now = state.copy()
        for k in range(1, len(times)):
            fly(now, 0.004, air, now)
            path[k] = now[:3]
        values = path @ normal + plane[3] * times + plane[4]
        falls = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
        if len(falls):
            found += 1
            assert times[falls[0]] - 1e-9 <= t <= times[falls[0] + 1] + 1e-9
            assert out[:3] @ normal + plane[3] * t + plane[4] == pytest.approx(0, abs=1e-11)
        else:
            assert math.isnan(t) or t > times[-1] - 1e-9
    assert found > 15
