"""The moving circle's fit against points that lie on one, and against numpy."""

import numpy as np
import pytest

from core.detection.refined.circle_fit import EdgePoints, Fit, factorise, fit_circle, solve

pytestmark = pytest.mark.numeric
TRUE = np.array([101.3, 47.8, 2.1, -0.7, 9.4, 0.0])
BEND = (0.06, -0.11)


def points_on(circle: np.ndarray, angles: np.ndarray, ms: np.ndarray) -> EdgePoints:
    """Pixels' places (not rounded) on the circle at their times; those ahead of its middle are of the leading edge."""
    u0, v0, vu, vv, r, stretch = circle
    leads = np.cos(angles) * vu + np.sin(angles) * vv >= 0
    late = ms + np.where(leads, stretch, -stretch)
    u = u0 + vu * late + 0.5 * BEND[0] * late**2 + r * np.cos(angles)
    v = v0 + vv * late + 0.5 * BEND[1] * late**2 + r * np.sin(angles)
    return EdgePoints(u, v, ms, np.zeros(len(ms)), np.where(leads, -1.0, 0.0), np.zeros(len(ms)))


def fit_from(start: np.ndarray, prior: np.ndarray, information: np.ndarray, bend: tuple[float, float] = BEND) -> Fit:
    return Fit(start.copy(), prior.copy(), information.copy(), np.array(bend), np.zeros((6, 6)))


@pytest.fixture
def edge() -> EdgePoints:
    rng = np.random.default_rng(1)
    return points_on(TRUE, rng.uniform(0, 2 * np.pi, 80), rng.uniform(-3, 0, 80))


def test_points_on_a_moving_circle_give_it_back_from_a_start_beside_it(edge) -> None:
    fit = fit_from(np.add(TRUE, [0.8, -0.6, 0.2, 0.2, 0.7, 0.2]), TRUE, np.zeros(6))
    residual = fit_circle(edge, 80, fit, 0.4, 0.5, 20)
    assert fit.estimate == pytest.approx(TRUE, abs=0.002)
    assert residual < 0.01


@pytest.mark.parametrize("stretch_ms", [0.3, 1.2])
def test_a_trailing_edge_that_lags_moves_neither_centre_nor_radius(stretch_ms: float) -> None:
    rng = np.random.default_rng(4)
    long = np.append(TRUE[:5], stretch_ms)
    seen = points_on(long, rng.uniform(0, 2 * np.pi, 120), rng.uniform(-3, 0, 120))
    fit = fit_from(TRUE, TRUE, np.zeros(6))
    fit_circle(seen, 120, fit, 0.4, 2.0, 30)
    assert fit.estimate == pytest.approx(long, abs=0.01)
    round_one = fit_from(TRUE, TRUE, np.array([0, 0, 0, 0, 0, 1e9]))
    assert fit_circle(seen, 120, round_one, 0.4, 2.0, 30) > 0.2 * stretch_ms, "a plain circle does not fit"


def test_a_fifth_of_the_points_somewhere_else_moves_it_little(edge) -> None:
    rng = np.random.default_rng(2)
    edge.u[:16] += rng.uniform(2, 6, 16)
    fit = fit_from(np.add(TRUE, [0.4, 0.3, 0.0, 0.0, 0.3, 0.0]), TRUE, np.zeros(6))
    fit_circle(edge, 80, fit, 0.4, 0.5, 20)
    assert np.hypot(*(fit.estimate[:2] - TRUE[:2])) < 0.25
    assert (edge.weight[16:] > 0.5).mean() > 0.9 and (edge.weight[:16] < 0.5).mean() > 0.7


def test_only_the_points_that_count_are_looked_at(edge) -> None:
    edge.u[40:] = 1e4
    fit = fit_from(TRUE + 0.1, TRUE, np.zeros(6))
    fit_circle(edge, 40, fit, 0.4, 0.5, 20)
    assert fit.estimate == pytest.approx(TRUE, abs=0.01)


def test_a_prior_says_what_the_points_do_not() -> None:
    angles, ms = np.linspace(0, 2 * np.pi, 40, endpoint=False), np.zeros(40)  # all at once: no velocity in them
    blind = fit_from(TRUE, TRUE, np.array([0, 0, 0, 0, 0, 1.0]))
    assert fit_circle(points_on(TRUE, angles, ms), 40, blind, 0.4, 0.5, 8) == np.inf
    prior = np.add(TRUE, [0, 0, 1.5, -0.5, 0, 0])
    told = fit_from(TRUE, prior, np.array([0, 0, 1, 1, 0, 1.0]))
    assert fit_circle(points_on(TRUE, angles, ms), 40, told, 0.4, 0.5, 8) < 0.01
    assert told.estimate == pytest.approx(prior, abs=1e-3)


def test_its_matrix_is_the_information_of_the_points_and_the_prior(edge) -> None:
    information = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    fit = fit_from(TRUE, TRUE, information, (0.0, 0.0))
    fit_circle(edge, 80, fit, 0.4, 0.5, 1)
    du, dv = edge.u - TRUE[0] - TRUE[2] * edge.ms, edge.v - TRUE[1] - TRUE[3] * edge.ms
    n = np.column_stack([du, dv]) / np.hypot(du, dv)[:, None]
    ahead = np.where(edge.lead != 0, 1.0, -1.0) * (n @ TRUE[2:4])
    rows = np.column_stack([n, n * edge.ms[:, None], np.ones(80), ahead])
    weights = 1 / (1 + ((np.hypot(du, dv) - TRUE[4]) / 0.5) ** 2)
    assert fit.normal == pytest.approx((weights[:, None] * rows).T @ rows / 0.4**2 + np.diag(information), rel=1e-6)


def test_the_small_solver_is_numpys() -> None:
    rng = np.random.default_rng(5)
    half = rng.standard_normal((7, 5))
    matrix, right = half.T @ half, rng.standard_normal(5)
    factor, found = np.zeros((5, 5)), np.zeros(5)
    assert factorise(matrix, factor)
    solve(factor, right, found)
    assert found == pytest.approx(np.linalg.solve(matrix, right))
    assert not factorise(np.diag([1.0, 1.0, 0.0, 1.0, 1.0]), factor)
