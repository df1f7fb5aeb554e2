"""Arcs one after the other: which of them a time, a plane and a landing belong to."""

import numpy as np
import pytest

from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory.continuation import Arcs, Continuation, continue_flights

pytestmark = pytest.mark.numeric
HIT_X_M = -1.42


def arcs(t_s: float, p: tuple[float, float, float], v: tuple[float, float, float]) -> Arcs:
    return Arcs(np.array([t_s]), np.array([p]), np.array([v]))


def test_the_fitted_arc_may_have_met_the_plane_before_its_reference() -> None:
    flight = Continuation((arcs(0.5, (-1.52, 0.1, 0.3), (-5.0, 0.5, 1.0)),))
    t, states = flight.hits(HIT_X_M)
    assert t[0] == pytest.approx(0.48)
    fallen = 0.3 - 0.02 * 1.0 - 0.5 * GRAVITY_MPS2 * 0.02**2
    np.testing.assert_allclose(states[0], [HIT_X_M, 0.09, fallen, -5.0, 0.5, 1.0 + GRAVITY_MPS2 * 0.02])


def test_an_arc_after_a_bounce_counts_from_that_bounce_on() -> None:
    away = arcs(0.0, (0.0, 0.0, 0.3), (1.0, 0.0, 0.0))
    beyond = arcs(0.2, (-1.52, 0.0, 0.02), (-5.0, 0.0, 2.0))
    t, states = Continuation((away, beyond)).hits(HIT_X_M)
    assert np.isnan(t).all() and np.isnan(states).all(), "it was there before it bounced, which nobody flew"
    before = arcs(0.2, (-1.32, 0.0, 0.02), (-5.0, 0.0, 2.0))
    assert Continuation((away, before)).hits(HIT_X_M)[0][0] == pytest.approx(0.22)


def test_an_arc_ends_where_the_next_one_begins() -> None:
    first = arcs(0.0, (0.0, 0.0, 0.3), (-5.0, 0.0, 0.0))  # at the plane after 284 ms
    for bounce_s, expected in ((0.2, 0.2 + 0.42 / 2.5), (0.3, 0.284)):
        second = arcs(bounce_s, (-1.0, 0.0, 0.02), (-2.5, 0.0, 2.0))
        assert Continuation((first, second)).hits(HIT_X_M)[0][0] == pytest.approx(expected)


def test_positions_are_those_of_the_arc_of_their_time() -> None:
    first, second = arcs(0.0, (0.0, 0.0, 0.3), (-5.0, 0.0, 0.0)), arcs(0.2, (-1.0, 0.0, 0.02), (-2.5, 0.0, 2.0))
    found = Continuation((first, second)).at(np.array([0.1, 0.1999, 0.2, 0.3]))[0, :, 0]
    np.testing.assert_allclose(found, [-0.5, -0.9995, -1.0, -1.25])


def test_a_flight_goes_on_off_the_table_at_the_speed_that_it_keeps() -> None:
    start = arcs(0.0, (0.5, 0.0, BALL_RADIUS_M + 0.2), (-4.0, 0.3, 0.0))
    flight = continue_flights(start, np.array([0.9]), np.array([0.8]))
    (t, p), *_ = flight.bounces()
    fall_s = np.sqrt(2 * 0.2 / GRAVITY_MPS2)
    assert t[0] == pytest.approx(fall_s)
    np.testing.assert_allclose(p[0], [0.5 - 4.0 * fall_s, 0.3 * fall_s, BALL_RADIUS_M])
    after = flight.arcs[1]
    np.testing.assert_allclose(after.vs_mps[0], [-3.2, 0.24, 0.9 * GRAVITY_MPS2 * fall_s])
    assert len(continue_flights(start, np.array([0.9]), np.array([0.8]), max_bounces=1).arcs) == 2


def test_the_landing_is_the_first_one_after_a_time() -> None:
    start = arcs(0.0, (0.5, 0.0, BALL_RADIUS_M + 0.2), (-2.0, 0.0, 0.0))
    flight = continue_flights(start, np.array([0.9]), np.array([0.8]))
    first_s = np.sqrt(2 * 0.2 / GRAVITY_MPS2)
    second_s = first_s + 2 * 0.9 * first_s
    for after_s, expected in ((0.0, first_s), (first_s + 0.01, second_s)):
        t, p = flight.landing(after_s)
        assert t[0] == pytest.approx(expected) and p[0, 2] == pytest.approx(BALL_RADIUS_M)
