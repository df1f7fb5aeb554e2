"""Flights and serves against closed forms."""

import numpy as np
import pytest

from core.errors import ConfigError
from core.simulation import FlightSeries, ServeConfig, draw_serves
from core.simulation.bounce import BounceConfig, bounce_on_table
from core.simulation.flight import Flight
from core.table import BALL_RADIUS_M, GRAVITY_MPS2, NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M


def test_a_flight_is_a_parabola_and_its_velocity_the_derivative() -> None:
    flight = Flight(np.array([1.0]), np.array([[1.0, 2.0, 3.0]]), np.array([[-4.0, 0.5, 2.0]]), np.zeros((1, 3)), 3.0)
    t = np.linspace(1.0, 2.9, 50)
    states = flight.at(t)
    expected_z = 3.0 + 2.0 * (t - 1) - GRAVITY_MPS2 * (t - 1) ** 2 / 2
    assert states.p_world_m[:, 2] == pytest.approx(expected_z)
    assert states.p_world_m[:, 0] == pytest.approx(1.0 - 4.0 * (t - 1))
    step = 1e-6
    ahead, behind = flight.at(t + step).p_world_m, flight.at(t - step).p_world_m
    assert ((ahead - behind) / (2 * step))[1:] == pytest.approx(states.v_world_mps[1:], abs=1e-5)


def test_there_is_no_ball_before_and_after_a_flight() -> None:
    flight = Flight(np.array([1.0]), np.zeros((1, 3)), np.ones((1, 3)), np.zeros((1, 3)), 2.0)
    states = flight.at([0.99, 1.0, 1.99, 2.0])
    assert states.present.tolist() == [False, True, True, False]
    assert np.isnan(states.p_world_m[0]).all() and np.isfinite(states.p_world_m[1]).all()


def test_a_bounce_reverses_the_fall_and_rubs_within_the_friction_cone() -> None:
    config = BounceConfig()
    v, spin = bounce_on_table(np.array([-4.0, 1.0, -3.0]), np.zeros(3), config)
    assert v[2] == pytest.approx(config.restitution * 3.0)
    lost = np.hypot(-4.0 - v[0], 1.0 - v[1])
    assert lost <= config.friction * (1 + config.restitution) * 3.0 + 1e-12
    assert v[0] * 1.0 - v[1] * -4.0 == pytest.approx(0.0, abs=1e-12), "spinless: it slows, it does not turn"
    contact = v + np.cross(spin, [0, 0, -BALL_RADIUS_M])
    assert np.dot(contact[:2], [-4.0, 1.0]) >= 0, "friction does not reverse the slip"


def test_a_bounce_never_adds_energy() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        v, spin = rng.normal(0, 4, 3), rng.normal(0, 100, 3)
        v[2] = -abs(v[2])
        v_after, spin_after = bounce_on_table(v, spin, BounceConfig(friction=rng.random()))
        inertia = 2 / 3 * BALL_RADIUS_M**2
        assert v_after @ v_after + inertia * spin_after @ spin_after <= v @ v + inertia * spin @ spin + 1e-9


@pytest.mark.parametrize("speed", [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
def test_serves_clear_the_net_and_bounce_once_on_the_robot_s_half(speed: float) -> None:
    series = draw_serves([ServeConfig(speed_mps=speed, yaw_spread_deg=3.0)] * 20, np.random.default_rng(int(speed)))
    for flight in series.flights:
        assert np.linalg.norm(flight.v_world_mps[0]) == pytest.approx(speed)
        t = np.linspace(flight.start_s[0], flight.end_s - 1e-9, 4000)
        states = flight.at(t)
        at_net = np.argmin(np.abs(states.p_world_m[:, 0]))
        assert states.p_world_m[at_net, 2] > NET_HEIGHT_M + BALL_RADIUS_M - 0.01
        assert len(flight.start_s) == 2
        x, y, z = flight.p_world_m[1]
        assert z == pytest.approx(BALL_RADIUS_M, abs=1e-9)
        assert -TABLE_LENGTH_M / 2 < x < 0 and abs(y) < TABLE_WIDTH_M / 2
        assert states.v_world_mps[-1, 0] < 0


def test_the_same_seed_draws_the_same_serves() -> None:
    first, again, other = (draw_serves([ServeConfig()] * 3, np.random.default_rng(seed)) for seed in (4, 4, 5))
    for one, two in zip(first.flights, again.flights, strict=True):
        assert np.array_equal(one.p_world_m, two.p_world_m) and np.array_equal(one.v_world_mps, two.v_world_mps)
    assert not np.array_equal(first.flights[0].p_world_m, other.flights[0].p_world_m)


def test_two_flights_at_once_are_refused() -> None:
    flight = draw_serves([ServeConfig()], np.random.default_rng(0)).flights[0]
    with pytest.raises(ConfigError, match="overlap"):
        FlightSeries((flight, flight))
