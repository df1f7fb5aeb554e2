"""How points move: what a ball can fly to, and the units in which it would."""

from __future__ import annotations

import numpy as np
import pytest

from core.physics.flight_motion import Units, bounce_heights, fall_of_flights, find_units, reachable

pytestmark = pytest.mark.numeric


def points_at(*xs_m: float) -> np.ndarray:
    return np.array([(x, 0.0, 0.3) for x in xs_m])


def test_of_three_points_the_one_that_is_far_from_both_others_cannot_be_reached() -> None:
    assert reachable(np.array([0.0, 0.01, 0.02]), points_at(0.0, 9.0, 0.1)).tolist() == [True, False, True]


def test_a_point_may_be_off_by_half_a_metre_and_no_more() -> None:
    times_s = 1e-5 * np.arange(7)  # in which nothing flies anywhere
    for off_m, is_reached in ((0.49, True), (0.6, False)):
        assert reachable(times_s, points_at(0, 0, 0, off_m, 0, 0, 0)).tolist() == [True] * 3 + [is_reached] + [True] * 3


@pytest.mark.parametrize(("off_m", "is_reached"), [(6.4, True), (6.6, False)])
def test_no_ball_flies_faster_than_60_mps(off_m, is_reached) -> None:
    """In 0.1 s from both sides: 6 m, and half a metre of error."""
    assert reachable(np.array([0.0, 0.1, 0.2]), points_at(0, off_m, 0)).tolist() == [True, is_reached, True]


def test_a_fall_is_measured_of_flights_that_last_long_enough() -> None:
    for length_s, fall_mps2 in ((0.15, None), (0.25, 9.81)):
        t_s = np.linspace(0, length_s, 25)
        found = fall_of_flights(t_s, np.column_stack([t_s, 0 * t_s, 1 - 4.905 * t_s**2]))
        assert found == (None if fall_mps2 is None else pytest.approx(fall_mps2))


def test_a_slow_ball_at_the_top_of_its_flight_tells_its_units() -> None:
    t_s = np.arange(-15, 16) / 100
    places_m = np.column_stack([1.2 * t_s, 0 * t_s, 1 - 4.905 * t_s**2])
    assert find_units(np.column_stack([t_s, places_m]), None, None) == [Units(1.0, 1.0)]


@pytest.mark.parametrize(("floor_m", "keeps", "heights_m"), [(0.78, 0.7, [0.78]), (0.02, 0.7, [0.02]), (0.5, -1.2, [])])
def test_a_bounce_keeps_the_direction_of_the_ball_and_a_racket_does_not(floor_m, keeps, heights_m) -> None:
    """5 m/s towards the robot and down onto something, then up at 3.1 m/s, and `keeps` along x."""
    t_s = np.arange(-0.2, 0.2, 0.004)
    down, up = 4.905 * 0.2**2 - 4.905 * (t_s + 0.2) ** 2 - 1.5 * t_s, 3.1 * t_s - 4.905 * t_s**2
    z_m = floor_m + np.where(t_s < 0, down, up)
    places_m = np.column_stack([np.where(t_s < 0, -5 * t_s, -5 * keeps * t_s), 0 * t_s, z_m])
    noise_m = np.random.default_rng(0).normal(0, 0.002, places_m.shape)
    assert bounce_heights(t_s, places_m + noise_m) == pytest.approx(heights_m, abs=0.02)
