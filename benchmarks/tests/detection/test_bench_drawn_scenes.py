"""The bench on drawn scenes: what it draws, keeps and writes."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from benchmarks.detection import bench_drawn_scenes as bench
from benchmarks.detection.bench_drawn_scenes import ROW_SCENES, SCORED_FROM, draw_flight
from core.cameras import stereo_preset
from core.metrics.grid_score import GridScore


def test_the_same_number_is_the_same_flight_whatever_the_sensor() -> None:
    for row in ROW_SCENES:
        for number in range(20):
            one, again = draw_flight(row, number, any_sensor=True), draw_flight(row, number, any_sensor=True)
            assert (one.stereo, one.launch, one.physics, one.placement) == (
                again.stereo, again.launch, again.physics, again.placement,
            )  # fmt: skip
            standard = draw_flight(row, number, any_sensor=False)
            assert (one.launch, one.placement) == (standard.launch, standard.placement)
            assert one.stereo.sensor != standard.stereo.sensor


def test_drawn_sensors_reach_over_the_stated_ranges() -> None:
    sensors = [draw_flight("ball", number, any_sensor=True).stereo.sensor for number in range(300)]
    for name, low, high in (
        ("on_threshold", 0.085, 0.46), ("threshold_mismatch", 0.03, 0.15), ("photoreceptor_us", 50, 800),
        ("refractory_us", 1, 200), ("noise_hz", 0.1, 5), ("hot_pixels_per_million", 0, 250),
    ):  # fmt: skip
        values = [getattr(sensor, name) for sensor in sensors]
        assert low <= min(values) and max(values) <= high
        assert min(values) < low + 0.1 * (high - low) and max(values) > high - 0.25 * (high - low)


def test_one_delay_takes_away_what_grows_with_the_speed_along_the_motion() -> None:
    speed = np.array([1.0, 2.0, 4.0])
    along, across = -0.3 * speed, np.array([0.1, 0.2, 0.0])
    late = GridScore(3, 3, 3, 0, np.hypot(along, across), along, speed)
    fitted = GridScore(2, 2, 2, 0, np.ones(2), np.array([-0.6, -1.5]), np.array([2.0, 5.0]))
    assert bench._after_delay(late, fitted) == pytest.approx(across)
    assert bench._after_delay(late, GridScore()) == pytest.approx(late.error_px), "nothing to fit with"


def test_an_interrupted_bench_goes_on_and_a_kept_score_is_the_same(tmp_path, monkeypatch) -> None:
    made = []

    def simulated(flight):
        made.append(flight)
        return {"refined": GridScore(9, 8, 8, 1, np.array([0.125]), np.array([-0.0625]), np.array([3.0]))}

    monkeypatch.setattr(bench, "_simulate_and_score", simulated)
    flight = draw_flight("slow", SCORED_FROM, any_sensor=True)
    first = bench.score_flight(flight, True, tmp_path)
    assert [one.number for one in made] == [SCORED_FROM, SCORED_FROM + 1], "and another one before the same sensor"
    one, other = made
    assert (one.stereo, one.placement, one.physics) == (other.stereo, other.placement, other.physics)
    again = bench.score_flight(flight, True, tmp_path)
    assert len(made) == 2
    for name in ("scored", "fitted"):
        one, other = asdict(first["refined"][name]), asdict(again["refined"][name])
        assert json.dumps(one, default=list) == json.dumps(other, default=list)


def test_a_small_run_makes_a_page(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(bench, "stereo_preset", lambda placement: {"left": stereo_preset(placement)["left"]})
    monkeypatch.setattr(bench, "get_args", lambda rows: ("ball",))
    shares: list[float] = []
    found = bench.run(shares.append, folder=tmp_path / "kept", report=tmp_path / "page.md", count=1)
    rows = found["rows"]
    assert isinstance(rows, list) and shares[-1] == 1.0
    by = {(row["sensor"], row["method"]): row for row in rows}
    assert set(by) == {(sensor, method) for sensor in ("standard", "drawn") for method in bench.METHODS}
    refined, auto = by["standard", "refined"], by["standard", "auto"]
    assert refined["precision"] > 0.98 and refined["recall"] > 0.9 and refined["median_px"] < 0.4 * auto["median_px"]
    assert "| ball | drawn | refined |" in (tmp_path / "page.md").read_text()
