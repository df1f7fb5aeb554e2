"""What counts as a lesson done, and what does not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.client_session.lesson_checks import (
    LessonFacts,
    check_compare,
    check_export,
    check_find,
    check_label,
    check_train,
    check_tune,
    label_errors_px,
)
from app.export.exporter import ExportState
from app.modes.tune.verdict_line import ScoredConfig, ShownWindow
from core.config import replace_setting
from core.detection import DetectorConfig
from core.recordings import PixelTruth
from labels.arrays import label_arrays
from labels.model import Label, LabelState

WINDOW = ShownWindow("right", 416_500, 0.3)
GOOD = ScoredConfig("left", "auto", DetectorConfig())
BAD = replace(GOOD, config=replace_setting(DetectorConfig(), ("geometry", "circularity_min"), 0.8))
MADE = ExportState("demo-1.rrd", False, 1.0, 3.0, "demo-1.rrd: 2 MB", False)


@pytest.mark.parametrize(
    ("check", "reached"),
    [
        (check_find, LessonFacts(second_camera=True, cursor_us=416_500, bounces_us=(416_500,), window=WINDOW)),
        (check_find, LessonFacts(second_camera=True, cursor_us=426_500, bounces_us=(1, 416_500), window=WINDOW)),
        (check_tune, LessonFacts(config=GOOD, scores=((GOOD, 0.951), (BAD, 0.48)))),
        (check_compare, LessonFacts(compared=2, misses_us=frozenset({532_000}), cursor_us=532_000)),
        (check_label, LessonFacts(label_errors_px=(0.2, 0.3, 1.0, 9.0, math.inf), labels_saved=True)),
        (check_train, LessonFacts(returned=0.9)),
        (check_export, LessonFacts(export=MADE)),
    ],
)
def test_a_lesson_is_done_when_its_goal_is_reached(check, reached) -> None:
    assert check(reached).done
    fresh = check(LessonFacts())
    assert not fresh.done and fresh.so_far


@pytest.mark.parametrize(
    "change",
    [
        {"second_camera": False},
        {"cursor_us": 426_501},
        {"bounces_us": ()},
        {"window": None},
        {"window": replace(WINDOW, miss_px=None)},
        {"window": replace(WINDOW, miss_px=8.5)},
        {"window": replace(WINDOW, miss_px=math.inf)},
    ],
)
def test_find_asks_for_a_right_ball_at_a_bounce_in_the_other_camera(change) -> None:
    reached = LessonFacts(second_camera=True, cursor_us=416_500, bounces_us=(416_500,), window=WINDOW)
    assert not check_find(replace(reached, **change)).done


@pytest.mark.parametrize(
    ("shown", "scores"),
    [
        (GOOD, ()),
        (GOOD, ((GOOD, 0.99),)),  # nothing was tuned
        (GOOD, ((BAD, 0.48),)),  # not scored again
        (BAD, ((GOOD, 0.99), (BAD, 0.48))),  # the bad one is shown
        (GOOD, ((GOOD, 0.95), (BAD, 0.48))),
        (GOOD, ((GOOD, 0.48), (GOOD, 0.99))),  # the newest score counts
        (GOOD, ((GOOD, math.nan), (BAD, 0.48))),
        (GOOD, ((GOOD, 0.99), (replace(BAD, camera="right"), 0.48))),
        (GOOD, ((GOOD, 0.99), (replace(BAD, method="ebpp"), 0.48))),
    ],
)
def test_tune_asks_for_a_low_score_and_a_better_one_of_what_is_shown(shown, scores) -> None:
    assert not check_tune(LessonFacts(config=shown, scores=scores)).done


@pytest.mark.parametrize(("compared", "cursor_us"), [(1, 532_000), (2, 532_001)])
def test_compare_asks_for_two_methods_and_a_look_at_a_miss(compared, cursor_us) -> None:
    facts = LessonFacts(compared=compared, cursor_us=cursor_us, misses_us=frozenset({532_000}))
    assert not check_compare(facts).done


@pytest.mark.parametrize(
    ("errors_px", "saved"),
    [((0.2,) * 4, True), ((0.2,) * 5, False), ((0.2, 0.2, 1.1, 1.2, 1.3), True), ((math.inf,) * 5, True)],
)
def test_label_asks_for_five_saved_balls_near_the_true_ones(errors_px, saved) -> None:
    assert not check_label(LessonFacts(label_errors_px=errors_px, labels_saved=saved)).done


@pytest.mark.parametrize("returned", [0.89, math.nan])
def test_train_asks_for_a_policy_that_returns(returned) -> None:
    assert not check_train(LessonFacts(returned=returned)).done


@pytest.mark.parametrize(
    "export",
    [
        replace(MADE, running=True, message=""),
        replace(MADE, failed=True, message="demo-1.rrd: no space left"),
        replace(MADE, message="cancelled"),
        replace(MADE, name="mine-1.rrd", message="mine-1.rrd: 2 MB"),
    ],
)
def test_export_asks_for_a_finished_file_of_the_demo(export) -> None:
    assert not check_export(LessonFacts(export=export)).done


def test_errors_of_labels_count_balls_only_and_are_infinite_where_none_is() -> None:
    times = np.array([0, 1000, 2000], np.int64)
    there = np.array([10.0, 20.0, np.nan])
    truth = PixelTruth(times, there, there, np.full(3, 8.0), np.array([True, True, False]))
    labels = label_arrays(
        [
            Label(t_us=0, state=LabelState.VISIBLE, x_px=13.0, y_px=14.0, r_px=8.0),
            Label(t_us=1000, state=LabelState.OUT_OF_FRAME),
            Label(t_us=2000, state=LabelState.VISIBLE, x_px=13.0, y_px=14.0, r_px=8.0),
        ]
    )
    assert label_errors_px(labels, truth) == (5.0, math.inf)
