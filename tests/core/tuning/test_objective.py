"""The number that is made as large as possible."""

import numpy as np
import pytest

from core.metrics.grid_score import GridScore
from core.tuning.objective import WORST, SplitScore, figures_of, measurably_differ


def counts(*, asked: int = 100, found: int = 90, answers: int = 95, false: int = 5, error_px: float = 1.0) -> GridScore:
    return GridScore(asked, found, answers, false, np.full(found, error_px))


def test_a_perfect_detector_is_worth_one() -> None:
    perfect = figures_of(counts(found=100, answers=100, false=0, error_px=0.0))
    assert (perfect.precision, perfect.recall, perfect.objective, perfect.balls) == (1.0, 1.0, 1.0, 100)


@pytest.mark.parametrize(
    "worse", [{"found": 80}, {"false": 10}, {"error_px": 2.0}], ids=["misses more", "invents more", "is farther off"]
)
def test_a_worse_detector_is_worth_less(worse: dict[str, float]) -> None:
    assert figures_of(counts(**worse)).objective < figures_of(counts()).objective  # type: ignore[arg-type]


def test_a_pixel_of_error_is_worth_two_points_of_f1() -> None:
    near, far = figures_of(counts(error_px=1.0)), figures_of(counts(error_px=2.0))
    assert near.objective - far.objective == pytest.approx(0.02)


def test_what_finds_nothing_is_the_worst_whether_it_says_something_or_not() -> None:
    silent, wrong = counts(found=0, answers=0, false=0), counts(found=0, answers=50, false=50)
    assert figures_of(silent).objective == figures_of(wrong).objective == WORST
    assert figures_of(GridScore()).objective == WORST


def test_scores_of_cameras_add_up_on_each_side() -> None:
    both = SplitScore(counts(), counts(asked=10, found=0)) + SplitScore(counts(found=70), counts(asked=5))
    assert (both.tuned.asked, both.tuned.found, both.held_out.asked) == (200, 160, 15)


@pytest.mark.parametrize(
    ("found", "error_px", "differs"), [(90, 1.0, False), (89, 1.0, False), (86, 1.0, True), (90, 1.2, False)]
)
def test_one_ball_or_a_hundredth_of_a_pixel_is_no_measurable_difference(
    found: int, error_px: float, differs: bool
) -> None:
    first, second = figures_of(counts()), figures_of(counts(found=found, error_px=error_px))
    assert measurably_differ(first, second) is measurably_differ(second, first) is differs
