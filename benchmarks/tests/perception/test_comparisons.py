import math
from dataclasses import replace

import pytest

from benchmarks.perception import comparisons
from benchmarks.perception.comparisons import NOT_MEASURED, PAPER_SCENES, SeedRun, compare, scene_verdict, verdict
from benchmarks.perception.results import PerceptionResult, RecordingReading

READING = RecordingReading(
    scene="ball", seed=7, recording="real1", seconds=2.0, events=1_000_000, frames=60, frames_with_ball=30,
    frame_bytes=2_000_000, frame_period_us=50_000, exposure_us=5000, read_ns=1.0, shown_us=None,
)  # fmt: skip
RESULT = PerceptionResult(
    scene="ball", seed=7, recording="real1", method="paper", window_us=2000, windows=100, asked=100, found=90,
    answers=1000, false=0, error_px=(1.0,), events=1_000_000, cpu_ms=(0.1,), recovery_ms=(), bound_px=(),
    pixel_bound_px=(), point_mm=(), points_without_ball=0, hits=0, hit_mm=(), shown=None,
)  # fmt: skip


def run_of(*errors: tuple[str, str, float], scene: str = "ball") -> SeedRun:
    results = tuple(replace(RESULT, recording=rec, method=method, error_px=(px,)) for rec, method, px in errors)
    names = dict.fromkeys(rec for rec, _, _ in errors)
    return SeedRun(7, results, tuple(replace(READING, recording=name, scene=scene) for name in names))


def test_the_data_of_a_detection_is_set_against_the_frames_of_a_ball() -> None:
    assert comparisons.frame_bytes_per_ball([READING]) == 4_000_000
    assert comparisons.data_saved([RESULT], [READING]) == pytest.approx(1 - 4000 / 4_000_000)
    assert comparisons.data_saved([RESULT], [READING], 3) == pytest.approx(1 - 3 * 4000 / 4_000_000)
    assert comparisons.rate_saved([READING]) == pytest.approx(1 - 2e6 / 40e6)
    without = replace(READING, frames=0, frames_with_ball=0, frame_bytes=0, frame_period_us=0)
    assert math.isnan(comparisons.data_saved([RESULT], [without])) and math.isnan(comparisons.rate_saved([without]))


def test_a_gain_is_that_of_the_best_recording_with_the_ball_only() -> None:
    run = run_of(("real1", "paper", 1.0), ("real1", "ebpp", 2.0), ("real2", "paper", 1.0), ("real2", "ebpp", 10.0))
    assert comparisons.best_accuracy_gain(run, "paper", "ebpp") == pytest.approx(0.9)
    peopled = run_of(("real4", "paper", 1.0), ("real4", "ebpp", 10.0), scene="person")
    assert math.isnan(comparisons.best_accuracy_gain(peopled, "paper", "ebpp"))
    worse = run_of(("real1", "paper", 2.0), ("real1", "ebpp", 1.0))
    assert comparisons.best_accuracy_gain(worse, "paper", "ebpp") == pytest.approx(-1.0)


def test_a_figure_holds_from_the_papers_digits_on() -> None:
    assert verdict(0.9976, 0.998) == "holds" and verdict(0.9974, 0.998) == "does not hold"
    assert verdict(math.nan, 0.998) == "not measured"


def test_a_scene_holds_if_all_three_figures_are_reached() -> None:
    paper = PAPER_SCENES["real6"]  # 1.000, 0.902, 2.59
    assert scene_verdict([replace(RESULT, found=91, error_px=(2.0,))], paper) == "holds"
    assert scene_verdict([replace(RESULT, found=90, false=1)], paper) == "does not hold: precision, recall"
    assert scene_verdict([replace(RESULT, found=91, error_px=(2.6,))], paper) == "does not hold: error"
    assert scene_verdict([], paper) == "not measured"


def test_what_needs_a_frame_detector_is_said_to_be_unmeasured_without_one() -> None:
    rows = {one.claim: one for one in compare([run_of(("real1", "paper", 1.0), ("real1", "ebpp", 20.0))])}
    assert [one.claim for one in rows.values() if one.verdict == NOT_MEASURED] == [
        "up to 96.4 % less latency than RGB, `paper`",
        "up to 96.4 % less latency than RGB, `refined`",
        "up to 27.5 % more recall than RGB, `paper`",
        "up to 27.5 % more recall than RGB, `refined`",
    ]
    assert rows["up to 99.8 % less data than RGB, `paper`"].verdict == "holds"
    accurate = rows["up to 89.7 % more accurate than event rivals, ball only: `paper` and `ebpp`"]
    assert accurate.ours == "95.0 %; of the median errors 95.0 %" and accurate.verdict == "holds"
    assert rows["up to 89.7 % more accurate than event rivals, ball only: `refined` and `ebpp`"].ours.startswith("-;")


def run_with_frames(sharp_recall: float) -> SeedRun:
    """Events: 90 of 100 found, 1.33 ms to the answer. Frames: 60 and 70 of 100 found, 2.5 + 8.3 + 20 ms."""
    events = [replace(RESULT, recording=name) for name in ("real1", "real2")]
    frames = [
        replace(RESULT, recording=name, method="yolo", found=found, events=0, cpu_ms=(20.0,), exposure_us=5000,
                frame_bytes=60 * 2_000_000, answers=found, sharp_recall=sharp_recall)
        for name, found in (("real1", 60), ("real2", 70))
    ]  # fmt: skip
    readings = tuple(replace(READING, recording=name) for name in ("real1", "real2"))
    return SeedRun(7, (*events, *frames), readings)


def test_the_frame_detector_is_asked_for_latency_recall_and_data() -> None:
    run = run_with_frames(0.95)
    assert comparisons.latency_saved(run, "paper") == pytest.approx(1 - 1.33 / 30.8, abs=1e-3)
    assert comparisons.latency_saved(run, "paper", sensing=True) == pytest.approx(1 - 1.33 / 10.8, abs=1e-3)
    assert comparisons.best_recall_gain(run, "paper") == pytest.approx(0.5)
    assert comparisons.recall_gain(run, "paper") == pytest.approx(90 / 65 - 1)
    assert comparisons.data_saved_of_found(run, "paper") == pytest.approx(1 - 4000 / (240e6 / 130))
    rows = {one.claim: one for one in compare([run])}
    assert rows["up to 96.4 % less latency than RGB, `paper`"].verdict == "does not hold"
    assert rows["up to 27.5 % more recall than RGB, `paper`"].verdict == "holds"
    assert rows["up to 27.5 % more recall than RGB, `refined`"].verdict == "not measured"


def test_a_frame_detector_that_misses_sharp_balls_is_no_rival() -> None:
    for one in compare([run_with_frames(0.89)]):
        if "less latency than RGB, `paper`" in one.claim or "more recall than RGB, `paper`" in one.claim:
            assert one.verdict == "no verdict: recall 0.89 of sharp frames is no rival's"
