import math

import numpy as np
import pytest

from core.detection import Detection, auto_config
from core.errors import RecordingError
from core.events import Events, SensorSize
from core.metrics import WindowAnswers, run_detector, score_answers, score_recording
from core.recordings import PixelTruth

pytestmark = pytest.mark.numeric
NAN = float("nan")


def answers(rows: list[tuple[int, float, float, int]]) -> WindowAnswers:
    """Time, u, v, further circles of each window."""
    t, u, v, extra = (np.array(column) for column in zip(*rows, strict=True))
    t = t.astype(np.int64)
    return WindowAnswers(
        t, t, u.astype(float), v.astype(float), np.where(np.isnan(u), NAN, 5.0), extra.astype(np.int32)
    )


def truth(t_us: list[int], u_px: list[float], visible: list[bool]) -> PixelTruth:
    shown = np.array(visible)
    u = np.where(shown, u_px, NAN)
    return PixelTruth(np.array(t_us, np.int64), u, np.where(shown, 50.0, NAN), np.where(shown, 6.0, NAN), shown)


BALL = truth([0, 10_000], [0.0, 100.0], [True, True])
"""It moves along v = 50 at 10 px per millisecond."""


def test_the_four_ways_a_window_can_end() -> None:
    found, missed, elsewhere = (2000, 23.0, 54.0, 0), (4000, NAN, NAN, 0), (6000, 90.0, 50.0, 0)
    score = score_answers(answers([found, missed, elsewhere]), BALL)
    assert (score.found, score.missed, score.false, score.with_ball) == (1, 2, 1, 3)
    assert (score.precision, score.recall, score.f1) == pytest.approx((1 / 2, 1 / 3, 2 / 5))
    assert score.mean_error_px == score.median_error_px == score.p95_error_px == pytest.approx(5.0)


def test_without_a_ball_an_answer_is_false_and_silence_is_right() -> None:
    nothing = truth([0, 10_000], [0.0, 0.0], [False, False])
    score = score_answers(answers([(2000, 5.0, 5.0, 0), (4000, NAN, NAN, 0)]), nothing)
    assert (score.windows, score.with_ball, score.found, score.missed, score.false) == (2, 0, 0, 0, 1)
    assert score.precision == 0.0 and math.isnan(score.recall) and math.isnan(score.median_error_px)


def test_windows_that_the_truth_does_not_reach_are_left_out() -> None:
    score = score_answers(answers([(10_000, 100.0, 50.0, 0), (10_001, 3.0, 3.0, 7), (12_000, NAN, NAN, 0)]), BALL)
    assert (score.windows, score.windows_unknown, score.found, score.false, score.extra_circles) == (1, 2, 1, 0, 0)


def test_the_first_and_the_last_sample_of_the_truth_belong_to_it() -> None:
    ball = truth([5000, 10_000], [50.0, 100.0], [True, True])
    rows = [(4999, 50.0, 50.0, 1), (5000, 50.0, 50.0, 2), (10_000, 100.0, 50.0, 3), (10_001, 100.0, 50.0, 4)]
    score = score_answers(answers(rows), ball)
    assert (score.windows, score.windows_unknown, score.found, score.false) == (2, 2, 2, 0)
    assert score.extra_circles == 5 and score.precision_all_circles == pytest.approx(2 / 7)
    before = score_answers(answers(rows[:1]), ball)
    assert (before.windows, before.windows_unknown, before.missed, before.false) == (0, 1, 0, 0)


def test_a_single_sample_of_the_truth_is_known_at_its_time_only() -> None:
    ball = truth([5000], [50.0], [True])
    score = score_answers(answers([(4999, 50.0, 50.0, 0), (5000, 50.0, 50.0, 0), (5001, 50.0, 50.0, 0)]), ball)
    assert (score.windows, score.windows_unknown, score.found) == (1, 2, 1)


def test_beside_a_sample_without_a_ball_nobody_is_asked_to_find_one() -> None:
    ball = truth([0, 1000, 2000, 3000], [0.0, 10.0, 20.0, 30.0], [True, True, False, True])
    score = score_answers(answers([(t, NAN, NAN, 0) for t in (999, 1000, 1001, 1999, 2000, 2001, 2999, 3000)]), ball)
    assert (score.windows, score.with_ball, score.missed) == (8, 3, 3)


def test_errors_are_summed_up_by_their_mean_middle_and_95th_percentile() -> None:
    rows = [(1000 * k, 10.0 * k + error, 50.0, 0) for k, error in enumerate([0.0, 1.0, 2.0, 3.0, 7.0], 1)]
    score = score_answers(answers(rows), BALL)
    assert (score.mean_error_px, score.median_error_px, score.p95_error_px) == pytest.approx((2.6, 2.0, 6.2))
    assert (score.precision, score.recall, score.f1) == (1.0, 1.0, 1.0)


def test_the_error_is_taken_at_the_time_of_the_estimate() -> None:
    late = WindowAnswers(*(np.array([x]) for x in (2000, 1000, 10.0, 50.0, 5.0)), np.zeros(1, np.int32))
    assert score_answers(late, BALL).mean_error_px == pytest.approx(0.0)


def test_the_match_radius_is_eight_pixels_included() -> None:
    assert score_answers(answers([(2000, 28.0, 50.0, 0)]), BALL).found == 1
    assert score_answers(answers([(2000, 28.01, 50.0, 0)]), BALL).found == 0


def test_further_circles_count_as_false_in_their_own_column() -> None:
    score = score_answers(answers([(2000, 20.0, 50.0, 2), (4000, 40.0, 50.0, 0)]), BALL)
    assert (score.precision, score.extra_circles, score.precision_all_circles) == pytest.approx((1.0, 2, 0.5))


def test_no_windows_and_no_truth_give_no_figures() -> None:
    empty = WindowAnswers(*(np.zeros(0, kind) for kind in (int, int, float, float, float, int)))
    for score in (score_answers(empty, BALL), score_answers(answers([(1, 1.0, 1.0, 0)]), truth([], [], []))):
        assert score.windows == 0 and math.isnan(score.precision) and math.isnan(score.f1)


class Stream:
    """One camera in memory: a ball that a detector which knows it finds in every other window."""

    name = "left"
    sensor = SensorSize(128, 96)
    event_count = 0
    calibration = None
    triggers = None
    truth: PixelTruth | None = BALL

    def slice(self, start_us: int, end_us: int) -> Events:
        return Events.empty(self.sensor)

    def counts_per_ms(self) -> np.ndarray:
        return np.zeros(10, np.int64)


class Knows:
    """Answers with the truth, but not before it was reset."""

    extra_circles = 0

    def __init__(self) -> None:
        self.ready = False

    def reset(self) -> None:
        self.ready = True

    def step(self, window) -> Detection | None:
        if not self.ready or window.start_us % 4000:
            return None
        return Detection(window.end_us, window.end_us / 100, 50.0, 6.0)


def test_a_recording_is_scored_window_by_window_with_progress() -> None:
    shares: list[float] = []
    score = score_recording(Stream(), Knows(), window_us=2000, progress=shares.append)
    assert (score.windows, score.found, score.missed, score.false) == (5, 3, 2, 0)
    assert score.mean_error_px == pytest.approx(0.0) and shares and all(0 < share <= 1 for share in shares)


def test_a_config_brings_its_own_windows() -> None:
    assert score_recording(Stream(), auto_config()).windows == 10_000 // auto_config().window.window_us


def test_a_cancelled_run_ends_with_what_it_has() -> None:
    assert len(run_detector(Stream(), Knows(), 100, cancelled=lambda: True).t_us) == 1
    assert len(run_detector(Stream(), Knows(), 100, cancelled=lambda: False).t_us) == 100


def test_a_recording_without_truth_cannot_be_scored() -> None:
    stream = Stream()
    stream.truth = None
    with pytest.raises(RecordingError, match="left"):
        score_recording(stream, auto_config())
