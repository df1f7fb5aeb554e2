import numpy as np
import pytest

from benchmarks.detection.bench_detection import accuracy, simulate_flights, time_both
from core.config import replace_setting
from core.detection import auto_config, paper_config
from core.metrics.run import duration_of
from core.recordings import CameraStream

NO_EVICTION = np.zeros(1, np.int64)


@pytest.fixture(scope="module")
def streams() -> list[CameraStream]:
    return simulate_flights("ball", 1.0, (6.0,), seed=4)


def test_both_cameras_have_events_and_truth_on_the_same_clock(streams) -> None:
    assert [stream.name for stream in streams] == ["left", "right"]
    for stream in streams:
        assert stream.counts_per_ms().sum() == stream.event_count > 100_000
        assert stream.truth.visible.any() and stream.truth.t_us[-1] <= duration_of(stream)


@pytest.mark.parametrize("mode", ["full", "roi"])
@pytest.mark.parametrize("config", [auto_config(), paper_config()], ids=["auto", "paper"])
def test_the_timed_windows_agree_and_both_paths_have_their_times(streams, mode: str, config) -> None:
    config = replace_setting(config, ("roi", "enabled"), mode == "roi")
    timing = time_both(streams, config, 2000, 40, NO_EVICTION)
    assert timing["windows"] == 40 and timing["differing"] == 0
    assert timing["ratio_p50"] == pytest.approx(timing["reference_p50_ms"] / timing["p50_ms"])
    assert 0 < timing["p50_ms"] <= timing["p99_ms"]


def test_simulated_balls_are_found_with_the_default_thresholds() -> None:
    """In most flights: after the bounce both methods follow the shadow for a while in about one view of four."""
    views = [[view] for seed in range(1, 6) for view in simulate_flights("ball", 1.0, (6.0,), seed=seed)]
    for config in (auto_config(), paper_config()):
        figures = [accuracy(view, config, 2000) for view in views]
        precision, recall = (np.array([one[name] for one in figures]) for name in ("precision", "recall"))
        assert np.median(precision) >= 0.95 and np.median(recall) >= 0.95
        assert precision.min() >= 0.7 and recall.min() >= 0.7
        assert max(one["median_error_px"] for one in figures) <= 2.0


def test_a_dark_ball_needs_auto() -> None:
    dark = simulate_flights("dark", 0.5, (6.0,), seed=4)
    auto, paper = (accuracy(dark, config, 2000) for config in (auto_config(), paper_config()))
    assert auto["precision"] >= 0.95 and auto["recall"] >= 0.95 and auto["median_error_px"] <= 2.0
    assert paper["median_error_px"] > 4.0
