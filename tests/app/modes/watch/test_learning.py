"""What is said and drawn of learning in the live rally."""

import math

import numpy as np

from app.modes.watch.learning import RANGE_MM, SHOWN, chart_columns, learning_html, reason_html
from core.online_learning.progress import LearnedBall, LearningProgress
from core.physics.episode import Case


def balls(*errors_mm: float, random: bool = False) -> tuple[LearnedBall, ...]:
    return tuple(
        LearnedBall(Case.NET if math.isnan(error) else Case.RETURNED, error, True, random) for error in errors_mm
    )


def test_nothing_is_said_before_learning_began() -> None:
    assert learning_html(None, on=False) == ""
    assert "0 balls learned from" in learning_html(LearningProgress("nothing", ()), on=True)


def test_the_lines_tell_balls_returns_and_the_median_of_the_last_ten() -> None:
    progress = LearningProgress("<mine>", balls(900.0, math.nan, *[20.0] * 4, *[40.0] * 6))
    said = learning_html(progress, on=True)
    assert "12 balls learned from" in said and "&lt;mine&gt;" in said
    assert "last 10: 10 returned, landing error 40 mm" in said and "all 12: 11 returned" in said
    assert "random" not in said and "another controller" not in said
    assert "random" in learning_html(LearningProgress("nothing", balls(50.0, random=True)), on=True)
    assert "another controller" in learning_html(progress, on=False)


def test_a_landing_that_is_not_known_stands_at_the_top_and_is_no_good_ball_in_the_median() -> None:
    progress = LearningProgress("nothing", balls(math.nan, math.nan, 10.0, 30.0, 50.0))
    numbers, errors, medians = chart_columns(progress)
    np.testing.assert_array_equal(numbers, [1, 2, 3, 4, 5])
    top = RANGE_MM[1]
    np.testing.assert_array_equal(errors, [top, top, 10, 30, 50])
    np.testing.assert_array_equal(medians, [top, top, top, top, 50])
    assert "unknown" in learning_html(LearningProgress("nothing", balls(math.nan)), on=True)


def test_the_chart_has_the_newest_balls_and_stays_within_its_range() -> None:
    numbers, errors, medians = chart_columns(LearningProgress("nothing", balls(*[2000.0] * 10, *[0.5] * SHOWN)))
    assert len(numbers) == SHOWN and numbers[0] == 11 and numbers[-1] == SHOWN + 10
    assert (errors == RANGE_MM[0]).all() and medians[0] == RANGE_MM[1] and medians[-1] == RANGE_MM[0]


def test_a_reason_is_one_line_and_no_markup() -> None:
    assert "&lt;b&gt;" in reason_html("<b>")
