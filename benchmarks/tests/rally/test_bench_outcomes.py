from pathlib import Path

import numpy as np
import pytest

from benchmarks.rally import bench_outcomes
from benchmarks.rally.bench_outcomes import ComparedBall, outcome_row


def test_a_ball_through_cameras_and_some_of_points_give_rows_and_a_page_and_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench_outcomes, "CHUNK", 1)
    page = tmp_path / "outcomes.md"
    found = bench_outcomes.run(
        lambda share: None, balls=1, count=4, physics="paper", folder=tmp_path / "kept", report=page
    )
    cameras, idle, points = found["rows"]  # type: ignore[misc]
    assert (cameras["seen_through"], cameras["balls"]) == ("cameras", 1)
    assert (idle["balls"], idle["cases"]) == (1, "missed 1/1")
    assert (points["seen_through"], points["balls"]) == ("points", 4)
    assert points["agree_low"] <= points["agree"] <= points["agree_high"]
    assert 0 < cameras["serve_late_ms_median"] < 200 and cameras["serve_mps_median"] < 0.5
    assert "| cameras | paper | 1 |" in page.read_text()

    def again(*_: object, **__: object) -> list[ComparedBall]:
        raise AssertionError("measured again")

    monkeypatch.setattr(bench_outcomes, "_measure_chunk", again)
    kept = bench_outcomes.run(lambda share: None, balls=1, count=4, physics="paper", folder=tmp_path / "kept")
    assert kept["rows"][0] == cameras  # type: ignore[index]


def test_a_row_counts_what_agrees_and_who_was_sure() -> None:
    def ball(told: int, judged: int, probability: float, off_m: float) -> ComparedBall:
        nan = float("nan")
        return ComparedBall(5.0, told, judged, probability, off_m, 4.0, nan, nan, nan, 0.1, 0.02, 50, 0.03)

    balls = [ball(4, 4, 0.99, 0.01), ball(3, 4, 0.6, 0.03), ball(1, 2, 0.95, np.nan), ball(5, 5, 0.7, np.nan)]
    row = outcome_row("points", "paper", balls)
    assert row["agree"] == 0.5 and (row["sure"], row["sure_and_wrong"]) == (2, 1)
    assert row["landing_mm_median"] == pytest.approx(20.0) and row["landing_nees"] == pytest.approx(4.0)
    assert row["net_mm_median"] is None
    assert row["cases"] == "own_half 0/1, out 0/1, returned 1/1, missed 1/1"
