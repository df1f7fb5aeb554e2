"""Speeds along a trail against flights whose speed is known."""

import numpy as np

from core.history.rally_history import trail_speeds_mps

T_US = np.arange(0, 200_000, 2_000)


def test_an_even_flight_has_its_speed_everywhere() -> None:
    ps = np.outer(T_US * 1e-6, [3.0, 0.0, 4.0])
    np.testing.assert_allclose(trail_speeds_mps(T_US, ps), 5.0)


def test_a_fall_is_as_fast_as_gravity_made_it() -> None:
    t = T_US * 1e-6
    ps = np.stack([np.zeros_like(t), np.zeros_like(t), -0.5 * 9.81 * t**2], axis=1)
    inner = slice(8, -8)
    np.testing.assert_allclose(trail_speeds_mps(T_US, ps)[inner], 9.81 * t[inner], rtol=1e-6)


def test_a_millimetre_of_noise_makes_less_than_a_tenth_of_a_metre_per_second() -> None:
    rng = np.random.default_rng(1)
    ps = np.outer(T_US * 1e-6, [5.0, 0.0, 0.0]) + rng.normal(0, 1e-3, (len(T_US), 3))
    assert np.abs(trail_speeds_mps(T_US, ps)[8:-8] - 5.0).std() < 0.1


def test_gaps_and_single_points_are_no_trouble() -> None:
    assert np.isnan(trail_speeds_mps(np.array([5]), np.zeros((1, 3)))).all()
    assert trail_speeds_mps(np.empty(0, np.int64), np.empty((0, 3))).shape == (0,)
    sparse = np.array([0, 100_000, 200_000])
    np.testing.assert_allclose(trail_speeds_mps(sparse, np.outer(sparse * 1e-6, [2.0, 0, 0])), 2.0)
