"""The whole bench on one short recording: a flight of 0.8 s, two cameras, frames."""

import re
from dataclasses import replace

import pytest

from core.bench.perception import bench_paper_perception as bench
from core.bench.perception import plan
from core.bench.perception.results import kept_reading, kept_result
from core.rally.data_sets import DataSetPlan, PlannedRecording
from core.rally.data_sets.plan import Making
from core.rally.data_sets.presets import PAPER7
from core.simulation.frames.frames import FrameConfig


def one_flight(seed: int) -> DataSetPlan:
    making = Making(frames=FrameConfig(rate_hz=10.0, exposure_us=1000))
    flight = PlannedRecording(
        name="real1", scene="ball", placement="side", speeds_mps=(9.0,), robot=False, seed=seed, making=making
    )
    return DataSetPlan("one flight", seed, (flight,))


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("perception")
    shares: list[float] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "seed_plan", one_flight)
        found = bench.run(shares.append, folder=folder, report=folder / "report.md", count=1)
    return folder, found, shares


def test_every_method_has_a_row_and_the_refined_one_is_the_nearest(measured) -> None:
    _, found, shares = measured
    rows = {row["method"]: row for row in found["rows"]}
    assert tuple(rows) == plan.METHODS and shares[-1] == 1.0
    for row in rows.values():
        assert 0.8 < row["precision"] <= 1 and 0.8 < row["recall"] <= 1 and row["point_median_mm"] < 10
        assert 0 < row["cpu_p50_ms"] < row["latency_p50_ms"] < row["latency_p99_ms"]
        assert 1000 < row["bytes_per_detection"] < 50_000
    refined = rows["refined"]
    assert refined["error_median_px"] == min(row["error_median_px"] for row in rows.values()) < 0.4
    assert refined["hits_told"] == 1.0 and refined["hit_median_mm"] < 5
    assert refined["error_median_px"] > found_bound(measured), "nobody is better than the bound"


def found_bound(measured) -> float:
    folder, found, _ = measured
    result = kept_result(plan.result_path(folder, found["seeds"][0], "real1", "refined"))
    assert result is not None and len(result.bound_px) > 10
    assert all(a <= b for a, b in zip(result.bound_px, result.pixel_bound_px, strict=True))
    return sorted(result.bound_px)[len(result.bound_px) // 2]


def test_the_pages_have_the_comparisons_and_the_pictures(measured) -> None:
    folder, found, _ = measured
    text, page = (folder / "report.md").read_text(), (folder / "report.html").read_text()
    assert (folder / "images" / "perception-window.png").read_bytes().startswith(b"\x89PNG")
    for words in ("not measured: no frame detector here yet", "How it is measured", "`fe-fusion`"):
        assert words in text
    assert len(re.findall("data:image/png;base64,iVBOR", page)) == 1 and "not measured" in page
    assert [row["verdict"] for row in found["comparisons"]].count("not measured: no frame detector here yet") == 2


def test_what_is_kept_is_not_measured_again_and_a_removed_result_is(measured, monkeypatch) -> None:
    folder, found, _ = measured
    seed = found["seeds"][0]
    asked = []
    monkeypatch.setattr(bench, "measure_method", lambda recording, method: asked.append(method) or again)
    path = plan.result_path(folder, seed, "real1", "paper")
    again = kept_result(path)
    whole = bench.run_seed(one_flight(seed), folder, lambda share: None, with_recordings=False)
    assert asked == [] and len(whole.results) == len(plan.METHODS)
    path.unlink()
    assert bench.run_seed(one_flight(seed), folder, lambda share: None, with_recordings=False) == whole
    assert asked == ["paper"]


def test_a_result_of_another_version_is_not_taken(measured, tmp_path) -> None:
    (tmp_path / "old.json").write_text('{"seed": 7}')
    assert kept_result(tmp_path / "old.json") is None and kept_reading(tmp_path / "old.json") is None


def test_changed_settings_are_another_result_and_the_paper_predicts_by_its_own_rule(monkeypatch, tmp_path) -> None:
    before = plan.result_path(tmp_path, 7, "real1", "refined")
    changed = replace(plan.ChainConfig.of_method("refined"), max_lag_ms=7.0)
    monkeypatch.setattr(plan, "chain_of", lambda method: changed)
    assert plan.result_path(tmp_path, 7, "real1", "refined") != before
    monkeypatch.undo()
    assert plan.chain_of("paper").prediction == "fit" and plan.chain_of("auto").prediction == "filter"


def test_a_seed_is_the_preset() -> None:
    planned = plan.seed_plan(8)
    assert [(one.scene, one.placement) for one in planned.recordings] == [(scene, place) for scene, place, _ in PAPER7]
    assert planned.seed == 8 and all(one.making.frames is not None for one in planned.recordings)
