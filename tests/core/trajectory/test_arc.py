"""Parabolas fitted, evaluated and reflected, against numpy's polynomials and a table's edges."""

import numpy as np
import pytest

from core.trajectory.continuation import Arcs, fit_arcs, reflect, time_back_to, time_down_to

pytestmark = pytest.mark.numeric
G = 9.81


def one(p: tuple[float, float, float], v: tuple[float, float, float], t_s: float = 2.0) -> Arcs:
    return Arcs(np.array([t_s]), np.array([p]), np.array([v]))


def test_a_fit_is_the_line_through_what_gravity_leaves() -> None:
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 0.3, (2, 7)), axis=1)
    ps = rng.normal(0, 1, (2, 7, 3))
    observed = np.ones((2, 7), np.bool_)
    observed[1, 3] = False
    arcs = fit_arcs(t, ps, observed)
    for row in range(2):
        times, places = t[row, observed[row]], ps[row, observed[row]]
        middle = times.mean()
        straight = places + np.outer((times - middle) ** 2, [0, 0, G / 2])
        slope, place = np.polyfit(times - middle, straight, 1)
        assert arcs.t_s[row] == pytest.approx(middle)
        np.testing.assert_allclose(arcs.ps_m[row], place, atol=1e-12)
        np.testing.assert_allclose(arcs.vs_mps[row], slope, atol=1e-10)
    lonely = fit_arcs(t[:1], ps[:1], np.arange(7)[None] == 2)
    assert np.isnan(lonely.ps_m).all() and np.isnan(lonely.vs_mps).all()


def test_places_velocities_and_crossings_are_those_of_the_school() -> None:
    arcs = one((0.5, -0.1, 0.42), (-4.0, 0.5, 1.0))
    np.testing.assert_allclose(arcs.at(np.array([2.1, 1.9]))[0, 0], [0.1, -0.05, 0.42 + 0.1 - G / 2 * 0.01])
    np.testing.assert_allclose(arcs.at(np.array([2.1, 1.9]))[0, 1], [0.9, -0.15, 0.42 - 0.1 - G / 2 * 0.01])
    np.testing.assert_allclose(arcs.velocities_at(np.array([2.1]))[0], [-4.0, 0.5, 1.0 - 0.1 * G])
    down = time_down_to(arcs, 0.02)[0] - 2.0
    assert down > 0 and 0.42 + down - G / 2 * down**2 == pytest.approx(0.02)
    assert np.isnan(time_down_to(arcs, 1.0)).all(), "it never is so high"
    assert time_back_to(arcs, -1.5)[0] == pytest.approx(2.5) and time_back_to(arcs, 0.9)[0] == pytest.approx(1.9)
    assert np.isnan(time_back_to(one((0.5, 0, 0.4), (4.0, 0, 0)), -1.5)).all()


@pytest.mark.parametrize(
    ("x", "y", "on_table"),
    [
        (-1.369, 0.762, True),
        (1.369, -0.762, True),
        (-1.371, 0.0, False),
        (1.371, 0.0, False),
        (0.0, 0.763, False),
        (0.0, -0.763, False),
    ],
)
def test_a_ball_is_reflected_where_its_centre_is_over_the_table(x: float, y: float, on_table: bool) -> None:
    t, v = 0.2, np.array([-3.0, 0.4, 0.0])
    start = (x + 3.0 * t, y - 0.4 * t, 0.02 + G / 2 * t * t)
    after = reflect(one(start, tuple(v)), np.array([0.9]), np.array([0.8]))
    if on_table:
        assert after.t_s[0] == pytest.approx(2.0 + t)
        np.testing.assert_allclose(after.ps_m[0], [x, y, 0.02], atol=1e-12)
        np.testing.assert_allclose(after.vs_mps[0], [-2.4, 0.32, 0.9 * G * t])
    else:
        assert np.isnan(after.t_s[0]) and np.isnan(after.ps_m).all() and np.isnan(after.vs_mps).all()
