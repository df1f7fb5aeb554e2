"""Several methods over the same recording."""

import numpy as np
import pytest

from core.detection import DetectorConfig, refined_config
from core.detection.methods import make_detector
from core.detection.window import EarlyEnds
from core.metrics import WindowAnswers, run_detector, score_answers
from core.metrics.compare import (
    ClassifiedRun,
    Comparison,
    ErrorRun,
    MethodRun,
    PixelReference,
    bin_edges,
    compare_methods,
    curves_over_time,
    false_stretches,
    judge_run,
    missed_stretches,
    run_method,
    truth_reference,
)
from core.metrics.delay import without_delay
from core.recordings import PixelTruth, open_recording

pytestmark = pytest.mark.numeric
NAN = float("nan")
LATE_US = 250
ASKED = np.arange(1000, 20_000, 1000)
END_US = 20_000


def true_u(t_us: np.ndarray) -> np.ndarray:
    """2 px/ms."""
    return 20 + 2e-3 * t_us


T = np.arange(0, END_US + 1, 500)
TRUTH = PixelTruth(T, true_u(T), np.full(len(T), 50.0), np.full(len(T), 6.0), np.ones(len(T), np.bool_))
REFERENCE = PixelReference("truth", "the truth", TRUTH, ASKED)


def run_with(off_px: dict[int, float], *, window_us: int = 1000) -> MethodRun:
    """Answers 0.25 ms late, off by so much in the windows that end then; nan is no answer."""
    ends = np.arange(window_us, END_US + 1, window_us)
    off = np.array([off_px.get(int(end), 0.5) for end in ends])
    said = ~np.isnan(off)
    t_us = np.where(said, ends - LATE_US, ends)
    columns = (true_u(t_us) + off, np.where(said, 50.0, NAN), np.where(said, 6.0, NAN))
    answers = WindowAnswers(ends, t_us, *columns, np.zeros(len(ends), np.int32))
    return MethodRun("refined", window_us, answers, np.linspace(1e-4, 3e-4, len(ends)))


def judge(off_px: dict[int, float], *, window_us: int = 1000) -> ClassifiedRun:
    return judge_run(run_with(off_px, window_us=window_us), REFERENCE)


def test_an_answer_in_every_window_finds_every_time_that_is_asked() -> None:
    for window_us in (500, 1000, 2000):
        judged = judge({}, window_us=window_us)
        assert judged.recall == judged.precision == 1.0 and judged.error_at(95) == pytest.approx(0.5)
        assert missed_stretches(judged, REFERENCE) == false_stretches(judged) == ()


def test_misses_and_false_answers_in_a_row_are_stretches_and_lead_to_their_first_window() -> None:
    judged = judge({5000: NAN, 6000: NAN, 12_000: 30.0, 15_000: NAN})
    assert judged.recall == pytest.approx(15 / 19) and judged.precision == pytest.approx(16 / 17)
    assert missed_stretches(judged, REFERENCE) == (
        ErrorRun(5000, 6000, 2, 6000, (30.0, 50.0)),
        ErrorRun(12_000, 12_000, 1, 13_000, (44.0, 50.0)),
        ErrorRun(15_000, 15_000, 1, 16_000, (50.0, 50.0)),
    )
    assert false_stretches(judged) == (ErrorRun(12_000 - LATE_US, 12_000 - LATE_US, 1, 12_000, (73.5, 50.0)),)


def test_a_method_that_never_answers_misses_everything_and_has_no_error() -> None:
    judged = judge(dict.fromkeys(range(1000, END_US + 1, 1000), NAN))
    assert judged.recall == 0.0 and np.isnan(judged.precision) and np.isnan(judged.error_at(50))
    assert missed_stretches(judged, REFERENCE) == (ErrorRun(1000, 19_000, 19, 1000, (22.0, 50.0)),)
    curves = curves_over_time(judged, np.array([0, END_US]))
    assert curves.recall.tolist() == [0.0] and np.isnan(curves.error_px).all() and curves.step_s[0] == 2e-4


def test_curves_say_what_each_bin_is_like() -> None:
    judged = judge({11_000: NAN, 12_000: 3.0, 13_000: 3.0, 14_000: 3.0, 15_000: 3.0, 16_000: 3.0})
    edges = np.array([0, 10_000, 20_000, 30_000])
    curves = curves_over_time(judged, edges)
    assert curves.recall[:2] == pytest.approx([1.0, 0.9]) and np.isnan(curves.recall[2])
    assert curves.error_px[:2] == pytest.approx([0.5, 3.0])
    assert curves.step_s[0] < 2e-4 < curves.step_s[1] and np.isnan(curves.step_s[2])


def test_bins_are_equal_cover_all_and_are_neither_too_many_nor_too_short() -> None:
    assert bin_edges(5000, 6000).tolist() == [5000, 6000]
    assert bin_edges(0, 40_000).tolist() == [0, 10_000, 20_000, 30_000, 40_000]
    assert len(bin_edges(0, 60_000_000)) == 81


@pytest.fixture(scope="module")
def stream(serve_recording):
    with open_recording(serve_recording) as recording:
        yield recording.cameras["left"]


@pytest.fixture(scope="module")
def compared(stream) -> Comparison:
    assert stream.truth is not None
    configs = {"auto": DetectorConfig(), "refined": refined_config()}
    return compare_methods(stream, configs, truth_reference(stream.truth, stream.sensor), 0, 600_000)


def test_methods_are_judged_as_the_score_judges_them(stream, compared: Comparison) -> None:
    for judged, config in zip(compared.judged, (DetectorConfig(), refined_config()), strict=True):
        method, window_us = judged.run.method, config.window.window_us
        answers = run_detector(stream, make_detector(method, stream.sensor, config), window_us)
        stated = score_answers(answers, stream.truth)
        score = score_answers(without_delay(answers, judged.delay_us), stream.truth)
        assert judged.error_at(50) < stated.median_error_px + 0.01, "a delay that is taken out makes no method worse"
        assert judged.precision == pytest.approx(score.precision)
        assert judged.error_at(50) == pytest.approx(score.median_error_px)
        assert len(judged.run.step_s) == len(answers.t_us) and 0 < judged.step_at(50) < judged.step_at(99) < 1
    auto, refined = compared.judged
    assert refined.recall > 0.9 and refined.error_at(50) < auto.error_at(50)


def test_without_truth_the_methods_are_asked_what_the_reference_method_answered(stream) -> None:
    shares: list[float] = []
    configs = {"auto": DetectorConfig(), "refined": refined_config()}
    agreed = compare_methods(stream, configs, "refined", 200_000, 300_000, progress=shares.append)
    auto, refined = agreed.judged
    assert agreed.reference.kind == "method" and agreed.reference.name == "refined"
    assert refined.recall == refined.precision == 1.0 and refined.error_at(99) == 0.0
    assert 0.5 < auto.recall <= 1.0 and 0 < auto.error_at(50) < 8
    assert shares == sorted(shares) and shares[-1] > 0.9
    only = compare_methods(stream, {"auto": DetectorConfig()}, "refined", 200_000, 300_000)
    assert [one.run.method for one in only.judged] == ["auto"] and only.judged[0].recall == auto.recall


def test_a_part_of_a_recording_is_answered_as_in_the_whole(stream, compared: Comparison) -> None:
    part = run_method(stream, "refined", refined_config(), 200_500, 300_000)
    whole = compared.judged[1].run.answers
    same = whole.rows((whole.end_us > 200_500) & (whole.end_us <= 300_000))
    assert part.answers.end_us[0] == 201_000 and part.answers.end_us.tolist() == same.end_us.tolist()
    assert np.abs(part.answers.u_px - same.u_px).max() < 0.5
    assert len(part.step_s) == len(same.end_us)


def test_windows_that_end_by_motion_or_events_are_more_and_their_answers_younger(stream, compared: Comparison) -> None:
    assert stream.truth is not None
    usual, reference = compared.judged[0], truth_reference(stream.truth, stream.sensor)
    for ends in (EarlyEnds(motion_px=3.0), EarlyEnds(events=300)):
        (early,) = compare_methods(stream, {"auto": DetectorConfig()}, reference, 0, 600_000, ends=ends).judged
        assert len(early.run.answers.end_us) > len(usual.run.answers.end_us)
        assert early.in_time is not None and usual.in_time is not None
        assert early.in_time.age_median_us < usual.in_time.age_median_us
        assert len(early.run.step_s) == len(early.run.answers.end_us)


def test_a_comparison_that_is_cancelled_ends_early(stream) -> None:
    part = compare_methods(stream, {"auto": DetectorConfig()}, "auto", 0, 600_000, cancelled=lambda: True)
    assert len(part.judged[0].run.step_s) <= 1
