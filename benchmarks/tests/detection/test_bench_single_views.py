"""The bench of single views: what it counts in a view, and its page."""

import numpy as np
import pytest

from benchmarks.detection import bench_single_views as bench
from benchmarks.detection.bench_single_views import ViewScore, first_events_us, longest_run, summarise_views
from core.cameras import stereo_preset
from core.events import Events, SensorSize
from core.metrics.grid_score import GridScore
from core.recordings import PixelTruth

SENSOR = SensorSize(200, 100)


def test_the_longest_run_is_of_false_answers_one_after_the_other() -> None:
    for flags, most in (("", 0), ("0", 0), ("111", 3), ("0110111101", 4)):
        assert longest_run(np.array([one == "1" for one in flags], np.bool_)) == most


def test_a_ball_is_seen_when_enough_of_its_rim_has_fired_in_a_short_time() -> None:
    t = np.arange(0, 50_001, 500)
    still = np.full(len(t), 50.0)
    truth = PixelTruth(t, still, still, np.full(len(t), 10.0), t >= 5000)
    angle = np.linspace(0.0, 6.0, 30)
    x, y = np.rint(50.0 + 10.0 * np.cos(angle)).astype(int), np.rint(50.0 + 10.0 * np.sin(angle)).astype(int)

    def events(t_us: np.ndarray, away_px: int = 0) -> Events:
        return Events.from_columns(t_us, x + away_px, y, np.ones(30, np.bool_), SENSOR)

    soon = 6000 + 100 * np.arange(30)
    assert first_events_us(events(soon), truth) == soon[bench.FIRST_EVENTS - 1]
    assert first_events_us(events(soon, away_px=40), truth) is None, "not at the ball"
    assert first_events_us(events(6000 + 400 * np.arange(30)), truth) is None, "too few at a time"
    assert first_events_us(events(100 * np.arange(30)), truth) is None, "no ball yet"


def test_a_row_names_its_worst_view_and_a_view_without_an_answer_has_no_first_one() -> None:
    good = ViewScore(GridScore(100, 100, 100, 0, np.full(100, 0.1)), 0, 4.0)
    bad = ViewScore(GridScore(100, 80, 100, 20, np.full(80, 0.3)), 12, np.inf)
    unseen = ViewScore(GridScore(), 0, None)
    row = summarise_views("ball", [good, bad, unseen])
    assert (row["recall"], row["worst_recall"], row["below_recall"]) == (0.9, 0.8, 1)
    assert (row["precision"], row["worst_precision"], row["below_precision"]) == (0.9, 0.8, 1)
    assert (row["longest_false"], row["first_ms"]) == (12, np.inf), "the upper one of two"
    assert summarise_views("ball", [good])["first_ms"] == 4.0
    assert np.isnan(summarise_views("ball", [unseen])["worst_recall"])


def test_a_small_run_makes_a_page(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(bench, "camera_preset", lambda name: {"left": stereo_preset(name)["left"]})
    monkeypatch.setattr(bench, "ROWS", {"ball": ("side",)})
    shares: list[float] = []
    found = bench.run(shares.append, seeds=(3,), report=tmp_path / "page.md")
    (row,) = found["rows"]
    assert shares[-1] == 1.0 and row["recall"] > 0.95 and row["precision"] > 0.98
    assert row["first_ms"] == pytest.approx(row["p90_ms"]) and row["first_ms"] < 30
    page = (tmp_path / "page.md").read_text()
    assert "--seeds 3`" in page and "| ball | 1 |" in page
