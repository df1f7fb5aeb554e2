"""Return rates by controller and scene."""

import pytest

from core.history.seen_outcomes import BallConditions, ReturnCounts
from core.metrics.score import binomial_interval

BUILT_IN, POLICY = BallConditions("built-in", "ball"), BallConditions("my-run", "ball")


def play(counts: ReturnCounts, conditions: BallConditions, returned: int, missed: int) -> None:
    for number in range(returned + missed):
        counts.begin_ball(conditions)
        counts.end_ball(conditions, returned=number < returned)


def test_each_controller_and_scene_has_a_row_with_its_interval() -> None:
    counts = ReturnCounts()
    play(counts, BUILT_IN, 41, 6)
    play(counts, POLICY, 3, 0)
    play(counts, BallConditions("built-in", "two-persons"), 1, 1)
    first, second, third = counts.rates()
    assert (first.conditions, first.balls, first.returned) == (BUILT_IN, 47, 41)
    assert first.interval == binomial_interval(41 / 47, 47) == pytest.approx((0.7483, 0.9402), abs=2e-4)
    assert (second.returned, second.balls, second.interval[1]) == (3, 3, 1.0) and second.interval[0] < 0.5
    assert (third.conditions.scene, third.returned, third.balls) == ("two-persons", 1, 2)


def test_a_ball_during_which_something_was_changed_counts_for_nobody() -> None:
    counts = ReturnCounts()
    counts.begin_ball(BUILT_IN)
    counts.end_ball(POLICY, returned=True)
    assert counts.rates() == ()


def test_a_ball_whose_serve_was_not_seen_does_not_count() -> None:
    counts = ReturnCounts()
    counts.end_ball(BUILT_IN, returned=True)
    counts.begin_ball(BUILT_IN)
    counts.drop_ball()
    counts.end_ball(BUILT_IN, returned=True)
    assert counts.rates() == ()


def test_a_row_knows_the_speeds_of_its_serves() -> None:
    counts = ReturnCounts()
    for speed_mps in (6.0, 5.0, 8.5):
        counts.begin_ball(BUILT_IN)
        counts.end_ball(BUILT_IN, returned=True, speed_mps=speed_mps)
    (rate,) = counts.rates()
    assert rate.speeds_mps == (5.0, 8.5) and (rate.balls, rate.returned) == (3, 3)


def test_a_reset_begins_anew() -> None:
    counts = ReturnCounts()
    play(counts, BUILT_IN, 2, 0)
    counts.clear()
    assert counts.rates() == ()
    play(counts, BUILT_IN, 0, 1)
    assert [(rate.returned, rate.balls) for rate in counts.rates()] == [(0, 1)]
