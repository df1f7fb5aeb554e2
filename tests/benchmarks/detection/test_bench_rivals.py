"""The bench of the rivals on one flight before one camera."""

import pytest

from benchmarks.detection import bench_rivals as bench
from benchmarks.detection.drawn_scenes import SCORED_FROM
from core.cameras import stereo_preset
from core.metrics.grid_score import GridScore


def test_its_flights_are_of_development_and_not_those_that_the_rivals_were_tuned_on() -> None:
    assert bench.FIRST > 2000 and bench.FIRST + bench.COUNT <= SCORED_FROM


def test_every_method_is_scored_and_timed_on_the_same_flight(monkeypatch) -> None:
    monkeypatch.setattr(bench, "stereo_preset", lambda placement: {"left": stereo_preset(placement)["left"]})
    monkeypatch.setattr(bench, "ROWS", ("ball",))
    shares: list[float] = []
    rows = bench.run(shares.append, count=1)["rows"]
    assert isinstance(rows, list) and shares == [1.0]
    assert tuple(row["method"] for row in rows) == bench.METHODS
    assert len({(row["row"], row["noise_hz"], row["flights"]) for row in rows}) == 1
    for row in rows:
        assert row["asked"] == pytest.approx(rows[0]["asked"], abs=2) and row["asked"] > 100
        assert row["median_px"] < 2.0
        if row["method"] in {"ebpp", "fe-fusion"}:
            assert row["precision"] > 0.9 and row["recall"] > 0.9
        assert 0.0 < row["p50_ms"] < row["p99_ms"]
        assert row["recall_low"] == row["recall"] == row["recall_high"], "of one flight only"


def test_the_interval_is_as_wide_as_the_flights_differ() -> None:
    def recall(score: GridScore) -> float:
        return score.recall

    same, apart = [GridScore(100, 90)] * 8, [GridScore(100, 100)] * 4 + [GridScore(100, 80)] * 4
    assert bench.interval_95(same, recall) == (0.9, 0.9)
    low, high = bench.interval_95(apart, recall)
    assert 0.80 < low < 0.86 and 0.94 < high < 1.0
