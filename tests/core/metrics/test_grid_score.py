"""Scores on a grid of times."""

import math

import numpy as np
import pytest

from core.events import SensorSize
from core.metrics import WindowAnswers
from core.metrics.grid_score import GridScore, errors_without_lag, image_velocity, lag_ms, score_on_grid
from core.recordings import PixelTruth

pytestmark = pytest.mark.numeric
SENSOR = SensorSize(400, 100)
T = np.arange(0, 60_001, 500)


def truth(px_per_ms: float = 3.0, hidden_us: tuple[int, int] = (0, 0)) -> PixelTruth:
    """A ball of 6 px from u = 20 on, behind something in between."""
    seen = (hidden_us[0] > T) | (hidden_us[1] <= T)
    u = np.where(seen, 20 + px_per_ms * T * 1e-3, np.nan)
    return PixelTruth(T, u, np.where(seen, 50.0, np.nan), np.where(seen, 6.0, np.nan), seen)


def answers(t_us: np.ndarray, *, px_per_ms: float = 3.0, off_u: float = 0.0, off_v: float = 0.0) -> WindowAnswers:
    u = 20 + px_per_ms * t_us * 1e-3 + off_u
    none = np.zeros(len(t_us), np.int32)
    return WindowAnswers(t_us + 200, t_us, u, np.full(len(t_us), 50.0 + off_v), np.full(len(t_us), 6.0), none)


EVERY_MS = np.arange(1000, 60_000, 1000) - 200
FAST, SLOW = (2.0, 1e9), (0.3, 2.0)


def score(said: WindowAnswers, true: PixelTruth, speeds=FAST, *, window_us: int = 1000) -> GridScore:
    return score_on_grid(said, true, SENSOR, speeds, window_us=window_us)


def test_an_answer_every_millisecond_finds_all_that_is_asked_after_the_first_ten() -> None:
    found = score(answers(EVERY_MS), truth())
    assert (found.asked, found.found, found.false, found.answers) == (49, 49, 0, 59)
    assert found.error_px == pytest.approx(0.0, abs=1e-9) and found.recall == found.precision == 1.0


def test_the_error_is_split_along_the_motion() -> None:
    found = score(answers(EVERY_MS, off_u=-0.6, off_v=0.8), truth())
    assert found.error_px == pytest.approx(1.0)
    assert found.along_px == pytest.approx(-0.6) and found.speed_px_per_ms == pytest.approx(3.0)


def test_what_comes_out_from_behind_something_has_ten_milliseconds() -> None:
    behind = truth(hidden_us=(20_000, 30_000))
    found = score(answers(EVERY_MS), behind)
    assert found.asked == 9 + 20, "11 to 19 ms, and 40 to 59 ms"
    assert found.false == 11, "and an answer while it is hidden is false"


def test_an_answer_elsewhere_is_false_and_a_silence_missed() -> None:
    half = EVERY_MS[EVERY_MS > 30_000]
    assert score(answers(half), truth()).recall == pytest.approx(29 / 49)
    wrong = score(answers(EVERY_MS, off_v=9.0), truth())
    assert wrong.precision == 0.0 and wrong.recall == 0.0 and math.isnan(wrong.error_at(50))


def test_rows_ask_for_balls_of_their_speed_but_count_every_false_answer() -> None:
    assert score(answers(EVERY_MS), truth(), SLOW).asked == 0
    slow = score(answers(EVERY_MS, px_per_ms=1.0), truth(1.0), SLOW)
    assert slow.asked == slow.found > 40
    assert score(answers(EVERY_MS, off_v=20.0), truth(), SLOW).false == 59


def test_long_windows_are_asked_once_a_window() -> None:
    every_other = EVERY_MS[::2]
    assert score(answers(every_other), truth(), window_us=2000).recall == 1.0
    assert score(answers(every_other), truth(), window_us=1000).recall == pytest.approx(0.5, abs=0.03)


def test_only_times_that_count_are_asked_and_judged() -> None:
    late = EVERY_MS > 40_000
    said = answers(np.concatenate([EVERY_MS[~late], EVERY_MS[late] - 100]), off_v=0.5)
    whole = score(said, truth())

    def counted(start_us: int, end_us: int) -> GridScore:
        return score_on_grid(
            said, truth(), SENSOR, FAST, window_us=1000, counts=lambda t_us: (start_us <= t_us) & (t_us < end_us)
        )

    early, rest = counted(0, 30_000), counted(30_000, 60_001)
    assert (early.asked, early.found, early.answers) == (19, 19, 30)
    assert (early + rest).asked == whole.asked and (early + rest).answers == whole.answers
    assert (early + rest).found == whole.found, "an answer just outside still finds a ball"
    assert len((early + rest).error_px) == len(whole.error_px) == 59
    assert counted(0, 0).answers == counted(0, 0).asked == 0


def test_an_empty_truth_and_no_answers_are_scored_too() -> None:
    nothing = PixelTruth(T[:0], np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.bool_))
    assert (score(answers(EVERY_MS), nothing).answers, score(answers(EVERY_MS), nothing).asked) == (0, 0)
    assert score(answers(EVERY_MS[:0]), truth()).found == 0 < score(answers(EVERY_MS[:0]), truth()).asked


def test_a_disc_that_is_cut_by_the_border_is_not_asked() -> None:
    leaving = truth(8.0)  # its rim is at the border at 46.6 ms
    assert score(answers(EVERY_MS, px_per_ms=8.0), leaving).asked == 46 - 10


def test_the_velocity_is_that_of_the_millisecond_before_and_after_a_gap_of_the_one_after() -> None:
    bent = PixelTruth(T, np.where(T < 30_000, T * 1e-3, 30 + 5 * (T - 30_000) * 1e-3), 0.0 * T, 6 + 0.0 * T, T >= 0)
    assert image_velocity(bent, np.array([0, 10_000, 30_000, 31_000]))[:, 0] == pytest.approx([1, 1, 1, 5])


def test_scores_add_up() -> None:
    both = GridScore(10, 9, 12, 1, np.ones(9), np.ones(9), np.ones(9)) + GridScore(5, 1, 2, 1)
    assert (both.asked, both.found, both.answers, both.false, len(both.error_px)) == (15, 10, 14, 2, 9)
    assert both.recall == pytest.approx(10 / 15) and both.precision == pytest.approx(12 / 14)
    assert math.isnan(GridScore().recall) and math.isnan(GridScore().error_at(50))


def test_answers_that_lag_behind_have_their_lag_and_no_error_without_it() -> None:
    late = answers(EVERY_MS, off_u=-0.4 * 3.0, off_v=0.25)
    found = score(late, truth())
    assert lag_ms(found) == pytest.approx(0.4, abs=0.01)
    assert errors_without_lag(found, 0.4) == pytest.approx(np.full(len(found.error_px), 0.25), abs=0.01)
    assert errors_without_lag(found, 0.0) == pytest.approx(found.error_px)


def test_slow_balls_and_no_answers_tell_no_lag() -> None:
    assert lag_ms(GridScore()) == 0.0
    slow = GridScore(2, 2, 2, 0, np.array([1.0, 1.2]), np.array([-1.0, -1.2]), np.array([0.1, 3.0]))
    assert lag_ms(slow) == pytest.approx(0.4)
