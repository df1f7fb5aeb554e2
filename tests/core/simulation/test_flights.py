"""Flights and serves against closed forms."""

import numpy as np
import pytest

from core.errors import ConfigError
from core.simulation import FlightSeries, LaunchConfig, draw_serve_series
from core.simulation.flights import ParabolicPath
from core.table import BALL_RADIUS_M, GRAVITY_MPS2, NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric


def arcs(series: FlightSeries) -> list[ParabolicPath]:
    """Its flights, which have a closed form."""
    assert all(isinstance(flight, ParabolicPath) for flight in series.flights)
    return [flight for flight in series.flights if isinstance(flight, ParabolicPath)]


def test_a_flight_is_a_parabola_and_its_velocity_the_derivative() -> None:
    flight = ParabolicPath(
        np.array([1.0]), np.array([[1.0, 2.0, 3.0]]), np.array([[-4.0, 0.5, 2.0]]), np.zeros((1, 3)), 3.0
    )
    t = np.linspace(1.0, 2.9, 50)
    states = flight.at(t)
    expected_z = 3.0 + 2.0 * (t - 1) - GRAVITY_MPS2 * (t - 1) ** 2 / 2
    assert states.p_world_m[:, 2] == pytest.approx(expected_z)
    assert states.p_world_m[:, 0] == pytest.approx(1.0 - 4.0 * (t - 1))
    step = 1e-6
    ahead, behind = flight.at(t + step).p_world_m, flight.at(t - step).p_world_m
    assert ((ahead - behind) / (2 * step))[1:] == pytest.approx(states.v_world_mps[1:], abs=1e-5)


def test_there_is_no_ball_before_and_after_a_flight() -> None:
    flight = ParabolicPath(np.array([1.0]), np.zeros((1, 3)), np.ones((1, 3)), np.zeros((1, 3)), 2.0)
    states = flight.at([0.99, 1.0, 1.99, 2.0])
    assert states.present.tolist() == [False, True, True, False]
    assert np.isnan(states.p_world_m[0]).all() and np.isfinite(states.p_world_m[1]).all()


PINNED = np.reshape([
    # start, position, velocity; bounce, velocity after it; end
    0.05, 1.09494768184, -0.192354967007, 0.388595996634, -4.88885764824, 0.135606473943, 1.03955845409,
    0.449868013558, -4.06747674198, 0.112823121169, 2.59483208302, 0.803908116753,
    0.883908116753, 0.370901730638, 0.207948600126, 0.394971978574, -2.71730176292, -0.0938902167991, 1.26785478522,
    1.31835425037, -1.86450307682, -0.0644236869433, 2.69465560705, 2.07303417865,
    2.15303417865, 1.41080999067, -0.0384465858821, 0.315681742272, -8.99892324304, -0.139213741756, 0.0,
    2.39855749886, -8.31255899443, -0.128595656383, 2.16772539417, 2.57917149254,
], (3, 12))  # fmt: skip


def test_seeds_serve_what_they_have_always_served() -> None:
    """Recordings made from a seed can be made again; the numbers are from the code before there was any air."""
    configs = [LaunchConfig(speed_mps=speed, yaw_spread_deg=2.0) for speed in (5.0, 3.0, 9.0)]
    series = draw_serve_series(configs, np.random.default_rng(7))
    for flight, pinned in zip(arcs(series), PINNED, strict=True):
        start, bounce = flight.p_world_m[0], flight.start_s[1]
        found = [flight.start_s[0], *start, *flight.v_world_mps[0], bounce, *flight.v_world_mps[1], flight.end_s]
        np.testing.assert_allclose(found, pinned, rtol=1e-11)


@pytest.mark.parametrize("speed", [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0])
def test_serves_clear_the_net_and_bounce_once_on_the_robot_s_half(speed: float) -> None:
    series = draw_serve_series(
        [LaunchConfig(speed_mps=speed, yaw_spread_deg=3.0)] * 20, np.random.default_rng(int(speed))
    )
    for flight in arcs(series):
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
    first, again, other = (draw_serve_series([LaunchConfig()] * 3, np.random.default_rng(seed)) for seed in (4, 4, 5))
    for one, two in zip(arcs(first), arcs(again), strict=True):
        assert np.array_equal(one.p_world_m, two.p_world_m) and np.array_equal(one.v_world_mps, two.v_world_mps)
    assert not np.array_equal(arcs(first)[0].p_world_m, arcs(other)[0].p_world_m)


def test_two_flights_at_once_are_refused() -> None:
    flight = draw_serve_series([LaunchConfig()], np.random.default_rng(0)).flights[0]
    with pytest.raises(ConfigError, match="overlap"):
        FlightSeries((flight, flight))
