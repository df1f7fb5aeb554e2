"""Scores in time: equal to a plain reference on any list of delays, to the usual score without any, worse with more."""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.metrics import WindowAnswers, score_answers
from core.metrics.streaming import (
    ASKED_EVERY_US,
    FRESH_US,
    VELOCITY_GAP_US,
    TimedRun,
    ages,
    arrival_times,
    asked_times,
    delay_curve,
    newest_answers,
    score_in_time,
)
from core.recordings import PixelTruth

pytestmark = pytest.mark.numeric
WINDOW_US = 1000


def flight(count: int, lost: set[int], late_us: list[int] | None = None) -> tuple[WindowAnswers, PixelTruth]:
    """A ball that crosses the picture at 2 px/ms, seen in all windows but the lost ones."""
    end = WINDOW_US * np.arange(1, count + 1, dtype=np.int64)
    t = end - (np.array(late_us, np.int64) if late_us is not None else 300)
    seen = np.array([row not in lost for row in range(count)])
    t = np.where(seen, t, end)
    u = np.array(np.where(seen, 20.0 + 2e-3 * t, np.nan), np.float64)
    v, r = np.where(seen, 50.0, np.nan), np.where(seen, 5.0, np.nan)
    grid = 100 * np.arange(10 * count + 20, dtype=np.int64)
    truth = PixelTruth(
        grid, 20.0 + 2e-3 * grid, np.full(len(grid), 50.0), np.full(len(grid), 5.0), np.ones(len(grid), np.bool_)
    )
    return WindowAnswers(end, t, u, v.astype(np.float64), r.astype(np.float64), np.zeros(count, np.int32)), truth


@pytest.mark.parametrize("moved", [False, True])
def test_at_given_times_it_is_the_newest_answer_of_a_plain_loop(moved: bool) -> None:
    answers, _ = flight(30, {4, 9, 10}, None)
    arrival_us = arrival_times(answers.end_us, np.full(30, 130.0), 700.0)
    asked_us = asked_times(answers)
    assert np.unique(np.diff(asked_us)).tolist() == [ASKED_EVERY_US] and len(asked_us) > 25
    newest = newest_answers(answers, arrival_us, moved=moved, asked_us=asked_us)
    age_us = ages(answers, arrival_us, asked_us)
    for row, asked in enumerate(asked_us.tolist()):
        there = [k for k in range(30) if arrival_us[k] <= asked]
        if not there or math.isnan(answers.u_px[there[-1]]):
            assert math.isnan(newest.u_px[row])
            continue
        last = there[-1]
        passed_us = asked - int(answers.t_us[last])
        known = moved and any(not math.isnan(answers.u_px[k]) for k in range(last))
        assert newest.u_px[row] == pytest.approx(answers.u_px[last] + (2e-3 * passed_us if known else 0.0))
        assert age_us[row] == passed_us


def test_long_windows_are_asked_between_their_answers_and_nothing_asked_gives_nothing() -> None:
    answers, truth = flight(30, set(), [0] * 30)
    soon_us = answers.end_us.astype(np.float64)
    assert score_in_time(answers, truth, soon_us).age_median_us == 0.0
    between = score_in_time(answers, truth, soon_us, asked_times(answers))
    assert between.age_median_us == pytest.approx(500, abs=60) and between.held_median_px > 0.8
    assert math.isnan(score_in_time(answers, truth, soon_us, np.empty(0, np.int64)).age_median_us)


def reference(answers: WindowAnswers, arrival_us: list[float], moved: bool) -> list[tuple[float, float] | None]:
    """The newest place at each answer's time, in plain loops."""
    places: list[tuple[float, float] | None] = []
    for asked in range(len(answers.t_us)):
        newest = None
        for row in range(asked + 1):
            if arrival_us[row] <= answers.t_us[asked]:
                newest = row
        if newest is None or math.isnan(answers.u_px[newest]):
            places.append(None)
            continue
        u, v = float(answers.u_px[newest]), float(answers.v_px[newest])
        before = [row for row in range(newest) if not math.isnan(answers.u_px[row])]
        if moved and before:
            passed = int(answers.t_us[newest] - answers.t_us[before[-1]])
            if 0 < passed <= VELOCITY_GAP_US:
                since = int(answers.t_us[asked] - answers.t_us[newest])
                u += (u - float(answers.u_px[before[-1]])) / passed * since
                v += (v - float(answers.v_px[before[-1]])) / passed * since
        places.append((u, v))
    return places


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_any_list_of_delays_gives_what_plain_loops_give(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 25))
    lost = data.draw(st.sets(st.integers(0, count - 1)))
    late = data.draw(st.lists(st.integers(0, 900), min_size=count, max_size=count))
    answers, _ = flight(count, lost, late)
    late_us = data.draw(st.lists(st.integers(-500, 6000), min_size=count, max_size=count))
    arrival = np.array(late_us, np.float64)
    arrival += answers.t_us
    for moved in (False, True):
        newest = newest_answers(answers, arrival, moved=moved)
        for row, place in enumerate(reference(answers, arrival.tolist(), moved)):
            if place is None:
                assert math.isnan(newest.u_px[row])
            else:
                assert (newest.u_px[row], newest.v_px[row]) == pytest.approx(place)


@pytest.mark.parametrize("lost", [set(), {0, 1, 7, 8, 30}, set(range(40))])
def test_without_delay_it_is_the_usual_score(lost: set[int]) -> None:
    answers, truth = flight(40, lost)
    score = score_in_time(answers, truth, answers.t_us.astype(np.float64))
    for one in (score.held, score.moved):
        assert astuple(one) == pytest.approx(astuple(score_answers(answers, truth)), nan_ok=True)


def test_a_held_answer_is_off_by_the_way_that_the_ball_went_and_a_moved_one_is_not() -> None:
    answers, truth = flight(200, {90, 91})
    score = score_in_time(answers, truth, (answers.t_us + 2000).astype(np.float64))
    assert score.held.median_error_px == pytest.approx(4.0)
    assert score.moved.median_error_px == pytest.approx(0.0, abs=1e-9)
    assert score.age_median_us == 2000


def test_more_delay_is_never_fresher_and_errors_of_a_steady_ball_grow() -> None:
    answers, truth = flight(300, {5, 60, 61, 62, 200})
    curve = delay_curve(TimedRun(answers, truth, np.full(300, 150.0)))
    fresh = [score.fresh for score in curve]
    assert fresh == sorted(fresh, reverse=True) and fresh[0] > 0.98
    age = [score.age_median_us for score in curve]
    assert age == sorted(age) and age[-1] > FRESH_US
    close = [score.held.median_error_px for score in curve if score.held.found]
    assert close == sorted(close) and len(close) >= 3


def test_what_takes_longer_than_a_window_builds_a_queue() -> None:
    end = WINDOW_US * np.arange(1, 6)
    assert arrival_times(end, np.full(5, 400.0), 50.0).tolist() == [1450, 2450, 3450, 4450, 5450]
    assert arrival_times(end, np.full(5, 1500.0)).tolist() == [2500, 4000, 5500, 7000, 8500]
    assert arrival_times(end, np.array([3000.0, 100, 100, 100, 100])).tolist() == [4000, 4100, 4200, 4300, 5100]


def test_the_age_is_that_of_the_last_ball_where_the_newest_answer_says_none() -> None:
    answers, _ = flight(6, {3, 4})
    age = ages(answers, answers.t_us.astype(np.float64))
    assert age.tolist() == [0, 0, 0, 1300, 2300, 0]
    assert np.isnan(ages(answers, np.full(6, np.inf))).all()
