"""The bench with equal chances: its protocol, what it keeps, and its page."""

import numpy as np
import pytest

from benchmarks.detection import bench_rivals as bench
from benchmarks.detection import equal_tuning
from benchmarks.detection.equal_tuning import (
    DELAYS,
    KINDS,
    FlightCamera,
    TrialScore,
    drawn_rows,
    score_answers,
    tune_equally,
    with_lag,
)
from core.config import field_specs, get_setting, replace_setting
from core.detection import DetectorConfig
from core.detection.methods import method_config
from core.events import Events, SensorSize
from core.metrics import WindowAnswers
from core.metrics.grid_score import GridScore
from core.recordings import PixelTruth

SENSOR = SensorSize(400, 100)


def test_nothing_is_scored_that_was_tuned_on_and_each_kind_has_all_its_rows() -> None:
    for kind, rows in KINDS.items():
        tuned = drawn_rows(kind, bench.TUNED_FROM, bench.TUNED_ON)
        scored = drawn_rows(kind, bench.SCORED, bench.COUNT)
        assert not set(tuned) & set(scored)
        assert {row for row, _ in tuned} == {row for row, _ in scored} == set(rows)


def test_every_method_has_a_delay_that_takes_its_lag() -> None:
    assert set(DELAYS) == set(bench.METHODS)
    for method, path in DELAYS.items():
        start = replace_setting(method_config(method), path, 200)
        assert get_setting(with_lag(method, start, 0.13), path) == 330
        bounds = next(one.bounds for one in field_specs(DetectorConfig) if one.path == path)
        assert bounds is not None
        assert get_setting(with_lag(method, start, -9.0), path) == bounds.low, "the least that the setting allows"


def test_a_lag_is_taken_out_of_the_answers_before_they_are_judged() -> None:
    t = np.arange(0, 60_001, 500)
    seen = np.ones(len(t), np.bool_)
    truth = PixelTruth(t, 20.0 + 4e-3 * t, np.full(len(t), 50.0), np.full(len(t), 6.0), seen)
    ends = np.arange(1000, 60_000, 1000)
    late = WindowAnswers(
        ends, ends, 20.0 + 4e-3 * (ends - 600), np.full(len(ends), 50.0), np.full(len(ends), 6.0),
        np.zeros(len(ends), np.int32),
    )  # fmt: skip
    camera = FlightCamera(Events.empty(SENSOR), truth, 60_000)
    assert score_answers(camera, late, 1000).error_at(50) == pytest.approx(2.4)
    assert score_answers(camera, late, 1000, 0.6).error_at(50) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("method", bench.METHODS)
def test_every_method_gets_the_same_number_of_trials_and_none_for_its_delay(method, monkeypatch) -> None:
    """The score of a config is its distance from a place: the search has to come nearer."""
    asked: list[DetectorConfig] = []

    def scored(flights, name, config, near_us) -> TrialScore:
        asked.append(config)
        return TrialScore(-abs(get_setting(config, goal) - 40.0), 0.1)

    start = method_config(method)
    goal = tuple(
        next(one for one in tune_names(method) if isinstance(get_setting(start, tuple(one.split("."))), float)).split(
            "."
        )
    )
    monkeypatch.setattr(equal_tuning, "score_trial", scored)
    shares: list[float] = []
    found = tune_equally(method, {}, 20, 0, shares.append)
    assert len(shares) == found.trials == 20 and shares[-1] == 1.0
    assert asked[0] == start, "the settings as they come are the first trial"
    assert len(asked) == len(set(asked)) <= 20
    assert found.best_objective >= found.start_objective
    assert ".".join(DELAYS[method]) not in found.searched
    assert found.delay_of(found.start) == get_setting(start, DELAYS[method]) + 100


def tune_names(method: str) -> list[str]:
    from core.tuning.parameters import choose_parameters

    return [one.name for one in choose_parameters(method, method_config(method))]


def test_a_figure_is_over_all_answers_and_lies_in_its_interval() -> None:
    flights = [GridScore(10, found, 10, 10 - found) for found in (10, 10, 9, 2)]
    value, low, high = bench.with_intervals(flights)["recall"]
    assert value == pytest.approx(31 / 40)
    assert low < 0.5 < value < high == pytest.approx(1.0)
    assert np.isnan(bench.with_intervals([GridScore()])["median_px"]).all()


def test_a_small_run_makes_a_page_and_the_same_command_keeps_everything(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(bench, "METHODS", ("paper", "ebpp"))
    monkeypatch.setattr(bench, "FRESH", {"ebpp": ("ebpp", "fresh_min")})
    monkeypatch.setattr(bench, "KINDS", {"ball only": ("ball",)})
    monkeypatch.setattr(bench, "TUNED_ON", 1)
    one_camera(monkeypatch)
    shares: list[float] = []
    asked = {"folder": tmp_path / "kept", "report": tmp_path / "page.md", "count": 1, "trials": 3}
    found = bench.run(shares.append, **asked)
    rows = found["rows"]
    assert isinstance(rows, list) and shares[-1] == 1.0
    assert [(row["method"], row["settings"]) for row in rows] == [
        ("paper", "as they come"), ("paper", "tuned"), ("ebpp", "as they come"), ("ebpp", "tuned"),
    ]  # fmt: skip
    assert all(row["recall"] > 0.5 for row in rows)
    page = (tmp_path / "page.md").read_text()
    assert "3\ntrials" in page or "3 trials" in page.replace("\n", " ")
    assert "| ball only | `ebpp` | tuned |" in page
    assert (tmp_path / "kept" / "tuned" / "ebpp.toml").is_file()
    monkeypatch.setattr(bench, "tune_equally", None)
    monkeypatch.setattr(bench, "answers_of", None)
    again = bench.run(shares.append, **asked)
    assert again["rows"] == rows and again["new_events"] == found["new_events"]


def one_camera(monkeypatch) -> None:
    """Half of the work: the right camera is left out."""
    both = equal_tuning.stereo_preset
    monkeypatch.setattr(equal_tuning, "stereo_preset", lambda name: {"left": both(name)["left"]})
