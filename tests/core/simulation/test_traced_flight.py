"""Flights through air, as event cameras follow them."""

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.events import SensorSize
from core.physics import PhysicsConfig, Serves, physics_profile
from core.physics.config import AirConfig
from core.simulation import LaunchConfig, StereoConfig, ball_truth, draw_serve_series, simulate_stereo, truth_times
from core.simulation.flights import ParabolicPath, TracedFlight, serve_flight
from core.table import BALL_RADIUS_M, NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric
REAL = physics_profile("real")
LAUNCH = Serves(np.array([[1.1, 0.1, 0.35]]), np.array([[-5.0, 0.0, 1.0]]), np.array([[0.0, -80.0, 40.0]]))


def traced(physics: PhysicsConfig = REAL, start_s: float = 0.05, exit_x_m: float = -2.3) -> TracedFlight:
    flight = serve_flight(LAUNCH, start_s, physics, exit_x_m=exit_x_m)
    assert isinstance(flight, TracedFlight)
    return flight


def test_velocity_is_the_derivative_and_acceleration_is_gravity_drag_and_lift() -> None:
    flight = traced()
    t = np.linspace(0.06, float(flight.discontinuities_s[1]) - 0.01, 40)
    h = 1e-5
    before, now, after = (flight.at(t + step) for step in (-h, 0.0, h))
    np.testing.assert_allclose((after.p_world_m - before.p_world_m) / (2 * h), now.v_world_mps, atol=1e-6)
    acceleration = (after.v_world_mps - before.v_world_mps) / (2 * h)
    v, spin = now.v_world_mps, now.spin_radps
    area, volume, mass = np.pi * 0.02**2, 4 / 3 * np.pi * 0.02**3, 0.0027
    drag = -0.5 * 0.554 * 1.204 * area / mass * np.linalg.norm(v, axis=1, keepdims=True) * v
    lift = 0.10 * 1.204 * volume / mass * np.cross(spin, v)
    np.testing.assert_allclose(acceleration, drag + lift + [0, 0, -9.81], atol=1e-3)


def test_the_ball_keeps_its_spin_in_the_air_and_bounces_as_the_table_says() -> None:
    flight = traced()
    bounce_s = float(flight.discontinuities_s[1])
    before, after = (flight.at(bounce_s + step) for step in (-1e-9, 1e-9))
    np.testing.assert_array_equal(before.spin_radps[0], LAUNCH.spins_radps[0])
    assert before.p_world_m[0, 2] == pytest.approx(BALL_RADIUS_M, abs=1e-6)
    assert after.v_world_mps[0, 2] == pytest.approx(-0.945 * before.v_world_mps[0, 2], abs=1e-5)
    assert after.spin_radps[0, 1] < before.spin_radps[0, 1], "the table adds topspin to a ball that flies to -x"


def test_there_is_a_ball_from_the_launch_to_the_end_and_each_end_is_a_launcher_s_mouth() -> None:
    flight = traced(start_s=1.0, exit_x_m=-1.8)
    end_s = flight.end_s
    states = flight.at([0.999, 1.0, end_s - 1e-6, end_s])
    assert states.present.tolist() == [False, True, True, False]
    assert np.isnan(states.p_world_m[[0, 3]]).all() and np.isnan(states.spin_radps[[0, 3]]).all()
    np.testing.assert_array_equal(states.p_world_m[1], LAUNCH.ps_m[0])
    assert states.p_world_m[2, 0] == pytest.approx(-1.8, abs=1e-4)
    visible_range = flight.visible_range([1.0, end_s - 1e-6])
    for normal, offset, p, heading in zip(
        visible_range.normal_world, visible_range.offset_m, states.p_world_m[1:3], (1, -1), strict=True
    ):
        assert normal @ p - offset == pytest.approx(-BALL_RADIUS_M, abs=1e-4), "the ball is wholly behind it"
        assert np.sign(normal[0]) == -heading


def test_hardly_any_air_gives_the_closed_form() -> None:
    thin = traced(PhysicsConfig(air=AirConfig(drag_coefficient=1e-12)))
    parabola = serve_flight(LAUNCH, 0.05, PhysicsConfig())
    assert isinstance(parabola, ParabolicPath)
    t = np.linspace(0.05, parabola.end_s - 1e-9, 500)
    np.testing.assert_allclose(thin.at(t).p_world_m, parabola.at(t).p_world_m, atol=1e-9)
    np.testing.assert_allclose(thin.discontinuities_s, parabola.discontinuities_s, atol=1e-9)


@pytest.mark.parametrize("speed", [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
def test_real_serves_clear_the_net_and_bounce_once_where_they_are_meant_to(speed: float) -> None:
    config = LaunchConfig(speed_mps=speed, yaw_spread_deg=3.0, spin_spread_radps=50.0)
    series = draw_serve_series([config] * 20, np.random.default_rng(int(speed)), REAL)
    for flight in series.flights:
        discontinuities_s = flight.discontinuities_s
        assert len(discontinuities_s) == 3
        states = flight.at(np.linspace(discontinuities_s[0], flight.end_s - 1e-9, 2000))
        assert np.linalg.norm(states.v_world_mps[0]) == pytest.approx(speed)
        at_net = np.argmin(np.abs(states.p_world_m[:, 0]))
        assert states.p_world_m[at_net, 2] > NET_HEIGHT_M + BALL_RADIUS_M - 0.01
        x, y, _ = flight.at(discontinuities_s[1]).p_world_m[0]
        assert abs(x - config.bounce_x_m) <= config.bounce_spread_m + 1e-9 and x > -TABLE_LENGTH_M / 2
        assert abs(y) < TABLE_WIDTH_M / 2


def test_the_same_seed_draws_the_same_real_serves() -> None:
    first, again, other = (
        draw_serve_series([LaunchConfig()] * 3, np.random.default_rng(seed), REAL).at([0.3, 1.0]).p_world_m
        for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_event_cameras_see_a_real_serve_and_its_truth_is_of_the_same_flight() -> None:
    cameras = stereo_preset(sensor=SensorSize(320, 180))
    series = draw_serve_series([LaunchConfig(speed_mps=6.0)], np.random.default_rng(1), REAL)
    counts = dict.fromkeys(cameras, 0)
    for chunk in simulate_stereo(StereoConfig(), cameras, series, seed=1, duration_us=300_000):
        for name, events in chunk.events.items():
            counts[name] += len(events)
    assert min(counts.values()) > 300
    truth = ball_truth(series, truth_times(series, 0, 300_000))
    assert truth.visible.sum() > 400
    speed = np.linalg.norm(truth.v_world_mps[truth.visible], axis=1)
    assert speed[0] == pytest.approx(6.0, abs=0.01) and speed[-1] < 5.5, "the air has slowed it"
