"""The one delay of sensor and method, found from answers against the truth and taken out of them."""

import numpy as np
import pytest

from core.events import SensorSize
from core.metrics import WindowAnswers
from core.metrics.delay import find_delay_us, without_delay
from core.metrics.score import score_answers
from core.recordings import PixelTruth

SENSOR = SensorSize(640, 480)
SPEED_PX_PER_US = 3e-3


def truth_of(speed_px_per_us: float = SPEED_PX_PER_US) -> PixelTruth:
    """A ball that flies to the right."""
    t_us = np.arange(0, 100_001, 500, dtype=np.int64)
    level = np.full(len(t_us), 240.0)
    return PixelTruth(t_us, 50 + speed_px_per_us * t_us, level, np.full(len(t_us), 8.0), np.ones(len(t_us), np.bool_))


def answers_of(late_us: int, truth: PixelTruth) -> WindowAnswers:
    """Right places of a moment that is earlier than what they state."""
    end_us = np.arange(20_000, 100_000, 1000, dtype=np.int64)
    at = truth.at(end_us - late_us)
    return WindowAnswers(end_us, end_us, at.u_px, at.v_px, at.r_px, np.zeros(len(end_us), np.int32))


@pytest.mark.parametrize("late_us", [230, 0, -250])
def test_answers_that_differ_only_in_their_stamp_have_the_same_errors_without_the_delay(late_us: int) -> None:
    truth = truth_of()
    answers = answers_of(late_us, truth)
    assert score_answers(answers, truth).median_error_px == pytest.approx(abs(late_us) * SPEED_PX_PER_US)
    delay_us = find_delay_us(answers, truth, SENSOR)
    assert delay_us == pytest.approx(late_us, abs=1)
    assert score_answers(without_delay(answers, delay_us), truth).median_error_px < 0.01


def test_a_ball_that_hardly_moves_and_no_ball_at_all_tell_no_delay() -> None:
    slow = truth_of(1e-5)
    assert find_delay_us(answers_of(500, slow), slow, SENSOR) == 0
    nothing = answers_of(0, truth_of()).rows(np.empty(0, np.intp))
    assert find_delay_us(nothing, truth_of(), SENSOR) == 0
