"""Crossings inside a short piece of flight, against the school parabola, whose crossings are roots of quadratics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from core.physics import crossing
from core.physics.crossing import COUNT, find_crossings, piece_at

pytestmark = pytest.mark.numeric
Array = NDArray[np.float64]

G = 9.81
RADIUS_M, HALF_LENGTH_M, TABLE_HEIGHT_M = 0.02, 1.37, 0.76
H_S = 0.05
NO_RACKET = np.array([0.0, 0.0, -50.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
"""A face that looks down from far below: no ball of these tests comes onto it."""


def ball(p: tuple[float, float, float], v: tuple[float, float, float]) -> Array:
    return np.array([*p, *v, 10.0, -20.0, 30.0])


def later(state: Array, t: float) -> Array:
    out = state.copy()
    out[:3] += state[3:6] * t - [0.0, 0.0, G / 2 * t * t]
    out[5] -= G * t
    return out


def crossings(
    start: Array, *, hit_x: float = -99.0, h: float = H_S, racket: tuple[Array, Array] | None = None
) -> Array:
    times = np.zeros(COUNT)
    find_crossings(start, later(start, h), h, *(racket or (NO_RACKET, NO_RACKET)), hit_x, times)
    return times


def only(which: int, t: float) -> Array:
    expected = np.full(COUNT, math.nan)
    expected[which] = t
    return expected


def test_a_piece_of_a_parabola_is_that_parabola_and_keeps_its_spin() -> None:
    start = ball((0.3, -0.2, 0.5), (-6.0, 1.5, 2.0))
    out = np.empty(9)
    for t in (0.0, 0.011, 0.04, H_S):
        piece_at(start, later(start, H_S), H_S, t, out)
        np.testing.assert_allclose(out, later(start, t), atol=1e-13)


def test_a_piece_goes_through_both_ends_of_a_flight_that_is_no_parabola() -> None:
    a, b = np.arange(1.0, 10.0), np.array([4.0, -3.0, 2.0, 1.0, 5.0, -6.0, 0.0, 0.0, 0.0])
    out, early, late = np.empty(9), np.empty(9), np.empty(9)
    for t, end in ((0.0, a), (0.2, b)):
        piece_at(a, b, 0.2, t, out)
        np.testing.assert_allclose(out[:6], end[:6], atol=1e-12)
    piece_at(a, b, 0.2, 0.08 - 1e-6, early)
    piece_at(a, b, 0.2, 0.08 + 1e-6, late)
    piece_at(a, b, 0.2, 0.08, out)
    np.testing.assert_allclose(out[3:6], (late[:3] - early[:3]) / 2e-6, rtol=1e-6)


@pytest.mark.parametrize(
    ("p", "v", "which", "t"),
    [
        # Down to z = R from 0.1 + R: 0.1 = 3 t + g/2 t^2.
        ((0.5, 0.1, 0.12), (0.0, 1.0, -3.0), crossing.DOWN, (-3 + math.sqrt(9 + 2 * G * 0.1)) / G),
        ((2.0, 0.1, -0.64), (0.0, 1.0, -3.0), crossing.FLOOR_PLANE, (-3 + math.sqrt(9 + 2 * G * 0.1)) / G),
        ((0.5, 0.0, 0.6), (0.0, 1.0, 0.3), crossing.TOP_OF_ARC, 0.3 / G),
        ((-0.12, 0.3, 0.6), (4.0, 0.0, -1.0), crossing.NET_PLANE, 0.03),
        ((0.12, 0.3, 0.6), (-4.0, 0.0, -1.0), crossing.NET_PLANE, 0.03),
        ((-HALF_LENGTH_M - 0.12, 0.3, 0.6), (4.0, 0.0, -1.0), crossing.END_PLANE, 0.03),
        ((HALF_LENGTH_M + 0.12, 0.3, 0.6), (-4.0, 0.0, -1.0), crossing.END_PLANE, 0.03),
    ],
)
def test_each_plane_is_crossed_when_the_parabola_says_and_no_other_is(
    p: tuple[float, float, float], v: tuple[float, float, float], which: int, t: float
) -> None:
    np.testing.assert_allclose(crossings(ball(p, v)), only(which, t), atol=1e-12)


def test_the_hitting_plane_is_crossed_towards_the_robot_only() -> None:
    there = crossings(ball((-0.93, 0.0, 0.5), (-3.0, 0.0, -1.0)), hit_x=-1.0)
    np.testing.assert_allclose(there, only(crossing.HIT_PLANE, 0.07 / 3), atol=1e-12)
    assert np.isnan(crossings(ball((-1.07, 0.0, 0.5), (3.0, 0.0, -1.0)), hit_x=-1.0)).all()


def test_a_crossing_at_the_end_of_a_piece_belongs_to_it_and_one_at_its_start_does_not() -> None:
    start = ball((-0.25, 0.0, 0.6), (4.0, 0.0, -1.0))
    assert crossings(start, h=0.0625)[crossing.NET_PLANE] == pytest.approx(0.0625)
    assert np.isnan(crossings(later(start, 0.0625), h=0.0625)[crossing.NET_PLANE])


@pytest.mark.parametrize("climb", [0.05, 0.2])
def test_a_ball_that_has_just_bounced_comes_down_after_its_hop(climb: float) -> None:
    hop = crossings(ball((0.5, 0.0, RADIUS_M), (0.0, 1.0, climb)))
    assert hop[crossing.DOWN] == pytest.approx(2 * climb / G, abs=1e-12)
    assert hop[crossing.TOP_OF_ARC] == pytest.approx(climb / G, abs=1e-12)
    high = crossings(ball((0.5, 0.0, RADIUS_M), (0.0, 1.0, 3.0)))
    assert np.isnan(high[crossing.DOWN]), "its hop is longer than the piece"


def test_a_ball_comes_onto_a_moving_turning_face_when_it_is_a_radius_in_front_of_it() -> None:
    """The face swings forward while its normal turns; normals in between are those of the chord, made unit."""
    start = ball((-1.2, 0.10, 0.30), (-4.0, 0.5, 1.0))
    normals = np.array([[1.0, 0.0, 0.0], [0.6, -0.64, 0.48]])
    at, speed = np.array([-1.35, 0.1, 0.3]), np.array([2.0, 0.2, 0.4])
    ends = tuple(np.concatenate([at + speed * t, speed, n]) for t, n in zip((0.0, H_S), normals, strict=True))
    t = float(crossings(start, racket=(ends[0], ends[1]))[crossing.FACE])
    assert 0.01 < t < 0.04

    def in_front_m(when: float) -> float:
        normal = normals[0] + (normals[1] - normals[0]) * when / H_S
        return float((later(start, when)[:3] - at - speed * when) @ normal / np.linalg.norm(normal))

    assert in_front_m(t) == pytest.approx(RADIUS_M, abs=1e-11) and in_front_m(t - 1e-4) > RADIUS_M
    behind = tuple(np.concatenate([at + speed * t, speed, -n]) for t, n in zip((0.0, H_S), normals, strict=True))
    assert np.isnan(crossings(start, racket=(behind[0], behind[1]))[crossing.FACE]), "it comes from behind"
