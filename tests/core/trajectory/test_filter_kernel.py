"""The steps of the filter against the textbook: closed forms, numerical derivatives, numpy's linear algebra."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from core.table import BALL_RADIUS_M, GRAVITY_MPS2, TABLE_WIDTH_M
from core.trajectory.ball_kernel import (
    AHEAD,
    FRICTION,
    HIGHER,
    LIFT,
    RESTITUTION,
    STATE,
    TOUCHES,
    bounce,
    glide,
    pull,
    touches,
)
from core.trajectory.filter_kernel import ProcessNoise, bounce_estimate, foresee, move, observe

pytestmark = pytest.mark.numeric
CALM = ProcessNoise(lift=LIFT * 0.10, air=0.0, bounce_mps=0.0, ahead_m=0.0, ahead_s=1e9)
START = np.array([1.2, 0.1, 0.30, -5.0, 0.4, 1.0, 20.0, -80.0, 40.0, 0.45, 0.93, 0.20, 0.001, 0.0])


def spread(seed: int = 0) -> np.ndarray:
    """A covariance (14, 14) with everything correlated, of plausible sizes."""
    root = np.random.default_rng(seed).normal(0, 1, (STATE, STATE))
    sizes = np.array([2e-3] * 3 + [0.05] * 3 + [10.0] * 3 + [0.02, 0.02, 0.02, 0.002, 0.004])
    return (root @ root.T / STATE) * np.outer(sizes, sizes)


def slopes(of, x: np.ndarray) -> np.ndarray:
    """(14, 14) derivatives of a map of states."""
    found = np.empty((STATE, STATE))
    for k in range(STATE):
        step = np.zeros(STATE)
        step[k] = 1e-3 if 6 <= k < 9 else 1e-5
        found[:, k] = (of(x + step) - of(x - step)) / (2 * step[k])
    return found


def glided(x: np.ndarray, seconds: float, lift: float = CALM.lift) -> np.ndarray:
    out = np.empty(STATE)
    glide(x, seconds, lift, out)
    return out


@pytest.mark.parametrize(("seconds", "within"), [(0.001, 5e-6), (0.010, 5e-4)])
def test_a_spread_moves_as_its_neighbours_fly(seconds: float, within: float) -> None:
    x, cov = START.copy(), spread()
    F = slopes(lambda s: glided(s, seconds), x)
    expected = F @ cov @ F.T
    move(x, cov, seconds, CALM)
    np.testing.assert_allclose(x, glided(START, seconds), atol=1e-12)
    sizes = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(cov / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), atol=within)
    np.testing.assert_allclose(cov, cov.T, rtol=1e-12)


@pytest.mark.parametrize("place_known", [False, True])
def test_a_spin_turns_the_spread_of_the_velocity_and_that_moves_the_place(place_known: bool) -> None:
    # Without drag the acceleration is a fixed matrix times the velocity, and the transition its exponential.
    x, cov = START.copy(), spread(5)
    x[6:10], lift = (300.0, -500.0, 400.0, 0.0), 0.01
    cov[6:], cov[:, 6:] = 0.0, 0.0
    if place_known:
        cov[:3], cov[:, :3] = 0.0, 0.0
    wx, wy, wz = x[6:9]
    rates = np.zeros((6, 6))
    rates[:3, 3:] = np.eye(3)
    rates[3:, 3:] = lift * np.array([[0, -wz, wy], [wz, 0, -wx], [-wy, wx, 0]])
    F = expm(0.010 * rates)
    expected = F @ cov[:6, :6] @ F.T
    move(x, cov, 0.010, CALM._replace(lift=lift))
    sizes = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(cov[:6, :6] / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), atol=2e-4)
    assert np.abs(F - np.eye(6) - 0.010 * rates).max() > 2e-3, "the second order matters here"


def test_a_long_flight_is_the_sum_of_short_ones() -> None:
    long, short = (START.copy(), spread()), (START.copy(), spread())
    move(*long, 0.025, CALM)
    for seconds in (0.010, 0.010, 0.005):
        move(*short, seconds, CALM)
    np.testing.assert_allclose(long[0], short[0], rtol=1e-12)
    np.testing.assert_allclose(long[1], short[1], rtol=1e-9, atol=1e-16)


def test_white_acceleration_makes_velocity_and_place_uncertain_as_its_integrals() -> None:
    # In still air without spin the equations are linear: q t, q t^2 / 2 and q t^3 / 3, however many steps it takes.
    x, cov = START.copy(), np.zeros((STATE, STATE))
    x[6:10] = 0.0
    t, air = 0.035, 0.5
    move(x, cov, t, CALM._replace(lift=0.0, air=air))
    q = air**2
    expected = np.zeros((STATE, STATE))
    for k in range(3):
        expected[k, k], expected[3 + k, 3 + k] = q * t**3 / 3, q * t
        expected[k, 3 + k] = expected[3 + k, k] = q * t**2 / 2
    still = np.ix_(range(6), range(6))
    drag = 1e-12  # the slope of drag with the speed, which is regularised
    np.testing.assert_allclose(cov[still], expected[still], rtol=1e-6, atol=drag)
    assert not cov[6:].any() and not cov[:, 6:].any()


def test_how_far_ahead_observations_are_is_forgotten_and_renewed() -> None:
    x, cov = START.copy(), np.zeros((STATE, STATE))
    x[AHEAD] = 0.004
    cov[AHEAD, AHEAD], cov[AHEAD, 12], cov[12, AHEAD], cov[12, 12] = 9e-6, 2e-6, 2e-6, 4e-6
    t, tau, size = 0.036, 0.05, 0.002
    move(x, cov, t, CALM._replace(ahead_m=size, ahead_s=tau))
    keep = math.exp(-t / tau)
    assert x[AHEAD] == pytest.approx(0.004 * keep)
    assert cov[AHEAD, AHEAD] == pytest.approx(9e-6 * keep**2 + (1 - keep**2) * size**2)
    assert cov[AHEAD, 12] == cov[12, AHEAD] == pytest.approx(2e-6 * keep) and cov[12, 12] == 4e-6


def bounced(x: np.ndarray) -> np.ndarray:
    """The state a little after the bounce of one a little before it, flown and bounced: time is the same for all."""
    before_s, after_s = 0.002, 0.002
    x = x.copy()
    gap = x[2] - BALL_RADIUS_M - x[HIGHER]
    t = 0.0
    for _ in range(20):
        there = glided(x, t)
        t += (there[2] - BALL_RADIUS_M - there[HIGHER]) / -there[5]
    assert gap > 0 and 0 < t < before_s + after_s
    there = glided(x, t)
    bounce(there)
    return glided(there, before_s + after_s - t)


@pytest.mark.parametrize("spin_y", [-80.0, 150.0])
def test_the_spread_after_a_bounce_is_that_of_balls_that_bounced_each_at_its_own_time(spin_y: float) -> None:
    at_table = START.copy()
    at_table[2], at_table[5], at_table[7] = BALL_RADIUS_M + at_table[HIGHER], -2.0, spin_y
    before = glided(at_table, -0.002)
    F = slopes(bounced, before)
    cov = spread(1) * 1e-4  # within which all is linear
    expected = F @ cov @ F.T
    x, found = before.copy(), cov.copy()
    move(x, found, 0.002, CALM)
    bounce_estimate(x, found, CALM)
    move(x, found, 0.002, CALM)
    np.testing.assert_allclose(x, bounced(before), atol=1e-9)
    sizes = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), atol=2e-3)


def test_a_bounce_scatters_each_component_of_the_velocity() -> None:
    covs = []
    for bounce_mps in (0.0, 0.1):
        x, cov = START.copy(), spread()
        x[2], x[5] = BALL_RADIUS_M + x[HIGHER], -2.0
        bounce_estimate(x, cov, CALM._replace(bounce_mps=bounce_mps))
        covs.append(cov)
    added = np.zeros((STATE, STATE))
    added[[3, 4, 5], [3, 4, 5]] = 0.1**2
    np.testing.assert_allclose(covs[1] - covs[0], added, atol=1e-12)
    assert x[5] == pytest.approx(2.0 * START[RESTITUTION])


NOISE = np.array([[4e-6, 1e-6, 0], [1e-6, 9e-6, -2e-6], [0, -2e-6, 16e-6]])
SCALES = np.array([0.25, 1.0, 4.0])


def picture(x: np.ndarray) -> np.ndarray:
    """(3, 14): what an observation changes by; it lies `ahead` along the velocity."""
    H = np.zeros((3, STATE))
    H[:, :3], H[:, AHEAD] = np.eye(3), x[3:6] / np.linalg.norm(x[3:6])
    return H


def textbook(x: np.ndarray, cov: np.ndarray, p: np.ndarray, scales: np.ndarray):
    """The update in its information form, and the innovation with its covariance."""
    H, R = picture(x), NOISE * np.sqrt(np.outer(scales, scales))
    miss = p - x[:3] - x[AHEAD] * x[3:6] / np.linalg.norm(x[3:6])
    after = np.linalg.inv(np.linalg.inv(cov) + H.T @ np.linalg.solve(R, H))
    return x + after @ H.T @ np.linalg.solve(R, miss), after, miss, H @ cov @ H.T + R


@pytest.mark.parametrize("scales", [np.ones(3), SCALES])
def test_an_observation_is_taken_as_in_the_textbook(scales: np.ndarray) -> None:
    x, cov = START.copy(), spread(2)
    x[AHEAD] = 0.003
    p = x[:3] + np.array([0.004, -0.003, 0.005])
    state, after, miss, S = textbook(x, cov, p, scales)
    distance, likelihood = observe(x, cov, p, NOISE, scales, 40.0, np.zeros((2, 3)))
    assert distance == pytest.approx(miss @ np.linalg.solve(S, miss), rel=1e-6)
    assert likelihood == pytest.approx(-0.5 * (distance + math.log(np.linalg.det(S))), rel=1e-9)
    sizes = np.sqrt(np.diag(after))
    np.testing.assert_allclose((x - state) / sizes, 0.0, atol=1e-5)
    np.testing.assert_allclose((cov - after) / np.outer(sizes, sizes), 0.0, atol=1e-5)


def test_a_stray_changes_nothing_and_speaks_no_louder_than_one_that_is_just_believed() -> None:
    far = START[:3] + np.array([0.3, 0.0, 0.0])
    found = []
    for gate in (40.0, 1e9):
        x, cov, tally = START.copy(), spread(2), np.zeros((2, 3))
        found.append((*observe(x, cov, far, NOISE, np.ones(3), gate, tally), x, cov, tally))
    (distance, likelihood, x, cov, tally), (same, louder, moved, *_) = found
    assert distance == same > 40.0 and np.abs(moved - START).max() > 0.1
    np.testing.assert_array_equal(x, START)
    np.testing.assert_array_equal(cov, spread(2))
    assert not tally.any()
    assert likelihood - louder == pytest.approx(0.5 * (distance - 40.0))


def test_the_gate_is_as_far_as_it_says() -> None:
    x, cov = START.copy(), spread(2)
    p = x[:3] + np.array([0.004, -0.003, 0.005])
    distance, _ = observe(x.copy(), cov.copy(), p, NOISE, np.ones(3), 1e9, np.zeros((2, 3)))
    for gate, taken in ((1.001 * distance, True), (0.999 * distance, False), (distance, True)):
        trial = x.copy()
        observe(trial, cov.copy(), p, NOISE, np.ones(3), gate, np.zeros((2, 3)))
        assert (trial != x).any() == taken


def test_what_an_observation_says_of_the_noise_is_unbiased_whatever_the_estimate_was() -> None:
    # Observations of one estimate with their true scatter, of which the noise is `true` times what is said of it.
    rng = np.random.default_rng(1)
    true, said = np.array([4.0, 1.0, 0.25]), np.array([1.0, 1.0, 1.0])
    x, cov = START.copy(), spread(3) * 1e-2
    R = np.diag(np.diag(NOISE))
    S = picture(x) @ cov @ picture(x).T + R * np.sqrt(np.outer(true, true))
    tally = np.zeros((2, 3))
    for miss in rng.multivariate_normal(np.zeros(3), S, 5_000):
        observe(x.copy(), cov.copy(), x[:3] + miss, R, said, 1e9, tally)
    np.testing.assert_allclose(tally[0] / tally[1], true, rtol=0.08)
    one = np.zeros((2, 3))
    observe(x.copy(), cov.copy(), x[:3] + np.array([0.001, 0.0, 0.0]), R, SCALES, 1e9, one)
    variance = np.diag(picture(x) @ cov @ picture(x).T) + np.diag(R) * SCALES
    np.testing.assert_allclose(one[1], (SCALES * np.diag(R) / variance) ** 2, rtol=1e-9)


@pytest.mark.parametrize("to_the_edge_m", [0.6, 0.003, -0.003])
def test_what_is_touched_spreads_as_it_differs_between_the_neighbours_on_both_sides(to_the_edge_m: float) -> None:
    """A ball that bounces well on the table, and two whose neighbours partly miss it: there one side has to do."""
    x, hit_x_m = START.copy(), -1.4
    bounces = np.empty((1, TOUCHES))
    touches(x[None], 0.0, hit_x_m, CALM.lift, bounces)
    x[1] += TABLE_WIDTH_M / 2 - to_the_edge_m - bounces[0, 2]
    rows, touched, found_spread = np.empty((27, STATE)), np.empty((27, TOUCHES)), np.empty((TOUCHES, TOUCHES))
    found = foresee(x, 9 * spread(3), 0.5, hit_x_m, CALM.lift, rows, found_spread)
    touches(rows, 0.5, hit_x_m, CALM.lift, touched)
    np.testing.assert_array_equal(found, touched[0])
    up, down = touched[1::2], touched[2::2]
    one_side = np.where(np.isnan(up), found - down, up - found)
    moves = np.nan_to_num(np.where(np.isnan(up) | np.isnan(down), one_side, (up - down) / 2))
    np.testing.assert_allclose(found_spread, moves.T @ moves, rtol=1e-9, atol=1e-15)
    assert np.isnan(found[2]) == (to_the_edge_m < 0)
    assert all(np.isnan(side[:, 2]).any() == (to_the_edge_m < 0.1) for side in (up, down))


def test_free_fall_is_exact() -> None:
    x = START.copy()
    x[6:10] = 0.0
    move(x, np.zeros((STATE, STATE)), 0.1, CALM)
    np.testing.assert_allclose(x[:3], START[:3] + 0.1 * START[3:6] - [0, 0, 0.5 * GRAVITY_MPS2 * 0.01], atol=1e-12)
    assert pull(x, CALM.lift) == (0.0, 0.0, -GRAVITY_MPS2)


@pytest.mark.parametrize(("sigma", "slips"), [(0.08, True), (0.01, False)])
def test_that_a_ball_rolls_off_the_table_depends_on_the_friction_that_was_assumed(sigma: float, slips: bool) -> None:
    x, cov = START.copy(), np.zeros((STATE, STATE))
    x[2:9] = (BALL_RADIUS_M + x[HIGHER], -2.7, 0.0, -2.6, 0.0, 0.0, 0.0)
    x[FRICTION], cov[FRICTION, FRICTION] = 0.23, sigma**2
    less = x.copy()
    less[FRICTION] -= sigma
    bounce(less)
    bounce_estimate(x, cov, CALM)
    assert x[7] == pytest.approx(x[3] / BALL_RADIUS_M), "it rolls"
    moved = x - less
    assert (abs(moved[3]) > 0.05) == slips
    # Speed and spin come from one push: what is seen of the one corrects the other, and the friction.
    np.testing.assert_allclose(cov[3], moved[3] * moved, atol=1e-12)
    np.testing.assert_allclose(cov[7], moved[7] * moved, atol=1e-9)
