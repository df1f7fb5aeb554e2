"""What a policy is worth, and what costs nothing."""

import dataclasses
import math

import numpy as np
import pytest

from core.learning.config import EnvironmentConfig
from core.learning.evaluation.policy_evaluator import (
    PolicyEvaluator,
    PolicyScore,
    oracle_actions,
    score_trivial_policies,
)
from core.learning.runs.summary import spread_of, summarise_scores

pytestmark = pytest.mark.numeric
TRUTH = EnvironmentConfig(state_source="truth")


def test_the_trivial_policies_score_what_they_did_when_the_task_was_chosen() -> None:
    evaluator = PolicyEvaluator(TRUTH, 300)
    found = score_trivial_policies(evaluator, 5.0, TRUTH)
    assert found.zero.return_rate == pytest.approx(0.57, abs=0.06)
    assert found.random.return_rate == pytest.approx(0.41, abs=0.06)
    assert found.constant_mm == pytest.approx(298, abs=15)
    assert found.oracle.return_rate == 1 and found.oracle.error_mm < 6


def test_the_oracle_takes_a_known_actuator_error_back() -> None:
    evaluator = PolicyEvaluator(TRUTH, 40)
    balls = evaluator.balls(5.0)
    biased = dataclasses.replace(balls, action_errors=np.full((40, 3), 0.1))
    difference = oracle_actions(balls, TRUTH)[:, 1:] - oracle_actions(biased, TRUTH)[:, 1:]
    assert np.median(difference) == pytest.approx(0.1, abs=0.02)


def test_a_missed_ball_is_not_returned_and_counts_as_far_off_as_the_table_is_long() -> None:
    score = PolicyScore(5.0, np.array([True, False, False]), np.array([10.0, 30.0, math.nan]))
    assert (score.return_rate, score.missed, score.error_returned_mm) == (
        pytest.approx(1 / 3),
        pytest.approx(1 / 3),
        10,
    )
    assert score.error_mm == pytest.approx((10 + 30 + 2740) / 3)
    row = summarise_scores([score, score])
    assert row["missed"] == pytest.approx(1 / 3) and row["seeds"] == 2 and row["balls"] == 3


def test_the_oracle_does_not_turn_the_face_about_its_normal_and_stays_in_range() -> None:
    balls = PolicyEvaluator(TRUTH, 20).balls(5.0)
    actions = oracle_actions(balls, TRUTH)
    assert (actions[:, 0] == 0).all() and np.abs(actions).max() <= 1
    assert len({tuple(action) for action in actions.round(6).tolist()}) > 15, "each ball has its own"


def test_a_row_has_the_distribution_of_all_balls_and_of_the_returned_ones() -> None:
    one = PolicyScore(5.0, np.array([True, True, False, False]), np.array([10.0, 20.0, 90.0, math.nan]))
    other = PolicyScore(5.0, np.array([True, False, False, False]), np.array([40.0, 60.0, math.nan, math.nan]))
    row = summarise_scores([one, other])
    assert (row["speed_mps"], row["balls"], row["seeds"], row["returned"], row["missed"]) == (5.0, 4, 2, 3 / 8, 3 / 8)
    errors = row["error_mm"]
    counted = [10, 20, 90, 2740, 40, 60, 2740, 2740]
    assert errors == {
        "mean": pytest.approx(np.mean(counted)),
        "std": pytest.approx(np.std(counted)),
        "median": pytest.approx(75.0),
        "p95": pytest.approx(2740.0),
    }
    assert row["error_returned_mm"]["median"] == 20.0  # type: ignore[index]
    assert row["seeds_returned"]["mean"] == pytest.approx(0.375)  # type: ignore[index]
    assert row["seeds_error_mm"]["mean"] == pytest.approx(np.mean(counted))  # type: ignore[index]


def test_where_every_ball_is_missed_there_is_no_error_of_returned_balls() -> None:
    missed = PolicyScore(5.0, np.zeros(3, np.bool_), np.full(3, math.nan))
    row = summarise_scores([missed])
    assert row["error_returned_mm"] == {"mean": None, "std": None, "median": None, "p95": None}
    assert row["error_mm"] == {"mean": 2740.0, "std": 0.0, "median": 2740.0, "p95": 2740.0}
    assert row["seeds_error_mm"] == {"mean": 2740.0, "std": None, "interval95": [None, None]}
    assert row["seeds_returned"] == {"mean": 0.0, "std": None, "interval95": [None, None]} and row["missed"] == 1.0


def test_the_interval_of_a_mean_is_student_s() -> None:
    spread = spread_of([1.0, 2.0, 3.0, 4.0, math.nan])
    assert (spread.mean, spread.count) == (2.5, 4)
    assert spread.std == pytest.approx(1.29099, abs=1e-5)
    assert spread.high - spread.mean == pytest.approx(3.18245 * 1.29099 / 2, abs=1e-4)
    assert math.isnan(spread_of([]).mean) and math.isnan(spread_of([1.0]).std)


def test_validation_balls_are_others_than_the_test_balls_and_always_the_same() -> None:
    evaluator = PolicyEvaluator(TRUTH, 50)
    test, validation = evaluator.balls(5.0), evaluator.balls(5.0, "validation")
    assert not np.isin(validation.states[:, 1], test.states[:, 1]).any()
    assert not np.isin(validation.goals_m[:, 0], test.goals_m[:, 0]).any()
    again = PolicyEvaluator(TRUTH, 50).balls(5.0, "validation")
    np.testing.assert_array_equal(again.states, validation.states)
