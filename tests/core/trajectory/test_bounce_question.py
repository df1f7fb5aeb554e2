"""How the filter decides whether the ball bounced."""

import math

import numpy as np
import pytest

from core.table import BALL_RADIUS_M, GRAVITY_MPS2, TABLE_LENGTH_M, TABLE_WIDTH_M
from core.trajectory.ball_filter import LONGEST_S, SIGMAS, BounceQuestion, TableTouch, _either, coming_contact
from core.trajectory.ball_kernel import HIGHER, STATE, glide
from core.trajectory.filter_kernel import ProcessNoise, bounce_estimate, move
from core.trajectory.observation import GATE, PointObservation

pytestmark = pytest.mark.numeric
STILL = ProcessNoise(lift=0.0, air=0.0, bounce_mps=0.0, ahead_m=0.0, ahead_s=1e9)
NOISE = 1e-6 * np.eye(3)


def falling(x: float = 0.0, y: float = 0.0, height: float = 0.0051, higher: float = 0.0) -> np.ndarray:
    """A ball without spin in still air, so high over the table."""
    return np.array([x, y, BALL_RADIUS_M + higher + height, -4.0, 0.5, -2.0, 0, 0, 0, 0.0, 0.9, 0.1, higher, 0.0])


def spread(sigma_m: float = 0.002, sigma_mps: float = 0.02) -> np.ndarray:
    return np.diag([sigma_m**2] * 3 + [sigma_mps**2] * 3 + [1.0] * 3 + [1e-6] * 3 + [1e-8, 0.0])


def drop_s(height: float) -> float:
    return (-2.0 + math.sqrt(4.0 + 2 * GRAVITY_MPS2 * height)) / GRAVITY_MPS2


def test_when_the_ball_comes_down_is_known_as_well_as_its_height_there() -> None:
    for higher in (0.0, 0.003):
        cov = spread()
        cov[2, 5] = cov[5, 2] = 2e-5
        cov[2, HIGHER] = cov[HIGHER, 2] = 1e-9
        contact = coming_contact(falling(height=0.05, higher=higher), cov, 0.0)
        assert contact is not None
        t = drop_s(0.05)
        assert contact.in_s == pytest.approx(t, abs=1e-9)
        variance = 4e-6 + 1e-8 - 2e-9 + 2 * 2e-5 * t + 4e-4 * t * t
        assert contact.sigma_s == pytest.approx(math.sqrt(variance) / (2.0 + GRAVITY_MPS2 * t), rel=1e-9)


def test_a_ball_below_the_table_or_that_stays_up_for_a_second_has_no_contact() -> None:
    assert coming_contact(falling(height=-0.001), spread(), 0.0) is None
    up = falling()
    up[5] = 5.0
    assert coming_contact(up, spread(), 0.0) is None
    assert coming_contact(falling(height=0.0), spread(), 0.0) == TableTouch(0.0, pytest.approx(0.001, rel=0.02))


def test_the_time_around_a_contact_is_bounded() -> None:
    contact = coming_contact(falling(), spread(sigma_m=0.5), 0.0)
    assert contact is not None and contact.sigma_s == pytest.approx(LONGEST_S / SIGMAS)


def question(x: np.ndarray, cov: np.ndarray | None = None, *, sigma_s: float = 0.0, guard_s: float = 0.0):
    cov = spread() if cov is None else cov
    contact = coming_contact(x, cov, 0.0)
    assert contact is not None
    return BounceQuestion(1000, x.copy(), cov.copy(), TableTouch(contact.in_s, sigma_s), STILL, guard_s), contact.in_s


def first_odds(x: float, y: float, sigma_m: float = 0.002) -> float:
    asked, _ = question(falling(x + 4.0 * drop_s(0.0051), y - 0.5 * drop_s(0.0051)), spread(sigma_m, 0.0))
    return asked._odds


@pytest.mark.parametrize(("axis", "half_m"), [(0, TABLE_LENGTH_M / 2), (1, TABLE_WIDTH_M / 2)])
@pytest.mark.parametrize("side", [-1, 1])
def test_before_anything_is_seen_the_odds_are_those_of_being_over_the_table(axis: int, half_m: float, side) -> None:
    def odds(beyond_sigmas: float) -> float:
        place = [0.0, 0.0]
        place[axis] = side * (half_m + beyond_sigmas * 0.002)
        return first_odds(*place)

    assert odds(0.0) == pytest.approx(0.0, abs=1e-3), "as likely as not on the very edge"
    on, off = 0.841345, 0.158655  # of a normal distribution, beyond one standard deviation
    assert odds(-1.0) == pytest.approx(math.log(on / off), rel=1e-3)
    assert odds(1.0) == pytest.approx(math.log(off / on), rel=1e-3)
    assert odds(-50.0) == pytest.approx(math.log(999)) and odds(50.0) == pytest.approx(-math.log(999))


def test_at_a_corner_both_edges_count() -> None:
    assert first_odds(TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2) == pytest.approx(math.log(1 / 3), abs=1e-3)


def truth(x: np.ndarray, t_s: float, bounces: bool) -> np.ndarray:
    """Where the ball is so long after the start."""
    down, there = drop_s(x[2] - BALL_RADIUS_M - x[HIGHER]), np.empty(STATE)
    if not bounces or t_s <= down:
        glide(x, t_s, 0.0, there)
        return there[:3]
    glide(x, down, 0.0, there)
    bounce_estimate(there, np.zeros((STATE, STATE)), STILL)
    glide(there, t_s - down, 0.0, there)
    return there[:3]


@pytest.mark.parametrize("bounces", [True, False])
def test_the_first_clear_points_decide_and_the_estimate_is_the_flight_that_they_fit(bounces: bool) -> None:
    x = falling()
    asked, in_s = question(x, spread(0.0005, 0.01))
    answers = []
    for k in range(1, 20):
        t_s = in_s + 1e-3 * k
        p = truth(x, t_s, bounces)
        answers.append(asked.add(1000 + round(1e6 * t_s), PointObservation(p, NOISE), np.ones(3)))
        if answers[-1] is not None:
            break
    assert answers[-1] == bounces and 1 <= len(answers) <= 3, "two flights part by 4 mm in a millisecond"
    np.testing.assert_allclose(asked.likelier[0][:3], p, atol=1e-4)
    assert (asked.likelier[0][5] > 0) == bounces
    if bounces:
        assert asked.bounced_us() == pytest.approx(1000 + 1e6 * in_s, abs=30)


@pytest.mark.parametrize(("rising_mps", "is_known"), [(0.15, True), (0.09, False)])
def test_a_ball_that_hardly_rises_left_the_table_when_it_was_expected_to(rising_mps: float, is_known: bool) -> None:
    asked, in_s = question(falling())
    asked.add(1000 + round(1e6 * in_s) + 9000, PointObservation(np.zeros(3), NOISE), np.ones(3))
    x = asked.off[0]
    x[2], x[5] = BALL_RADIUS_M + 0.001, rising_mps
    left_mps = math.sqrt(rising_mps**2 + 2 * GRAVITY_MPS2 * 0.001)
    since_us = 1e6 * (left_mps - rising_mps) / GRAVITY_MPS2
    expected = 1000 + 1e6 * in_s + (9000 - since_us if is_known else 0.0)
    assert asked.bounced_us() == pytest.approx(expected, abs=3)


def test_each_point_adds_the_likelihood_of_the_one_flight_and_takes_that_of_the_other() -> None:
    x = falling()
    asked, in_s = question(x)
    before = asked._odds
    t_us = 1000 + round(1e6 * in_s) + 300
    off, past = (asked.off[0].copy(), asked.off[1].copy()), (asked.past[0].copy(), asked.past[1].copy())
    move(*off, 300e-6, STILL)
    move(*past, (t_us - 1000) * 1e-6, STILL)
    p = off[0][:3] + np.array([0.0005, 0.0, -0.0005])
    asked.add(t_us, PointObservation(p, NOISE), np.ones(3))
    gain = 0.0
    for sign, (state, cov) in ((1, off), (-1, past)):
        S, miss = cov[:3, :3] + NOISE, p - state[:3]
        gain += sign * -0.5 * (min(GATE, miss @ np.linalg.solve(S, miss)) + math.log(np.linalg.det(S)))
    assert asked._odds - before == pytest.approx(gain, abs=0.02)


def test_points_that_cannot_tell_are_decided_by_the_odds_after_five() -> None:
    # So uncertain that both flights fit: the table's edge is what decides.
    for beyond_m, bounces in ((-0.001, True), (0.001, False)):
        x = falling(y=TABLE_WIDTH_M / 2 + beyond_m - 0.5 * drop_s(0.0051))
        asked, in_s = question(x, spread(0.002, 0.0))
        blurred = 1e6 * np.eye(3)
        answers = [
            asked.add(
                1000 + round(1e6 * in_s) + 100 * k,
                PointObservation(truth(x, in_s + 1e-4 * k, True), blurred),
                np.ones(3),
            )
            for k in range(1, 6)
        ]
        assert answers == [None] * 4 + [bounces]


def test_nothing_is_taken_while_the_bounce_may_be_going_on_or_is_guarded() -> None:
    x = falling()
    asked, in_s = question(x, sigma_s=0.001, guard_s=0.002)
    quiet_us = 1000 + round(1e6 * in_s) + 3000 + 2000
    kept = asked._odds
    for t_us in (1000 + round(1e6 * in_s) - 500, 1000 + round(1e6 * in_s) + 500, quiet_us - 1):
        assert asked.add(t_us, PointObservation(np.array([9.0, 9.0, 9.0]), NOISE), np.ones(3)) is None
        assert asked._odds == kept
    asked.add(quiet_us, PointObservation(truth(x, (quiet_us - 1000) * 1e-6, True), NOISE), np.ones(3))
    assert asked._odds > kept


def test_until_the_time_of_the_bounce_the_ball_flies_on_and_then_the_likelier_way() -> None:
    x = falling()
    asked, in_s = question(x, sigma_s=0.001)
    contact_us = 1000 + round(1e6 * in_s)
    asked.add(contact_us - 100, PointObservation(np.zeros(3), NOISE), np.ones(3))
    assert asked.likelier[0][5] < 0
    asked.add(contact_us, PointObservation(np.zeros(3), NOISE), np.ones(3))
    assert asked.likelier[0][5] > 0, "over the middle of the table it bounces"
    beside, in_s = question(falling(y=2.0), sigma_s=0.001)
    beside.add(1000 + round(1e6 * in_s) + 100, PointObservation(np.zeros(3), NOISE), np.ones(3))
    assert beside.likelier[0][5] < 0


@pytest.mark.parametrize(("odds", "likelier"), [(1e4, -1.0), (-1e4, -3.0)])
def test_a_flight_that_is_certain_alone_says_how_likely_a_point_was(odds: float, likelier: float) -> None:
    assert _either(-1.0, -3.0, odds) == pytest.approx(likelier)
