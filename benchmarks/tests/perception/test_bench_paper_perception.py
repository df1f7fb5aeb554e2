"""The whole bench on one short recording: a flight of 0.8 s, two cameras, frames."""

import re
from dataclasses import replace

import pytest
import torch

from benchmarks.perception import bench_paper_perception as bench
from benchmarks.perception import comparisons, measure
from benchmarks.perception import results as kept
from benchmarks.perception.results import kept_reading, kept_result
from core.data_sets import DataSetPlan, PlannedRecording
from core.data_sets.plan import PAPER7, Making
from core.detection.yolo.config import YoloConfig
from core.detection.yolo.network import YoloTiny
from core.detection.yolo.weights import SharpScore, YoloWeights, save_weights
from core.simulation.frames import FrameConfig


def one_flight(seed: int) -> DataSetPlan:
    making = Making(frames=FrameConfig(rate_hz=10.0, exposure_us=1000))
    flight = PlannedRecording(
        name="real1", scene="ball", placement="side", speeds_mps=(9.0,), robot=False, seed=seed, making=making
    )
    return DataSetPlan("one flight", seed, (flight,))


def orange_weights() -> YoloWeights:
    """An untrained network that is sure of some box: what it finds does not matter here, only what is made of it."""
    torch.manual_seed(0)
    score = SharpScore(recall=0.5, precision=0.9, median_error_px=1.0, pictures=10, seed=1)
    config = YoloConfig(input_width_px=320, input_height_px=192, width=0.0625, confidence=0.01)
    network = YoloTiny(config.width).eval()
    torch.nn.init.constant_(network.fine[1].bias, 1.0)
    return YoloWeights(network, config, score, {})


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("perception")
    shares: list[float] = []
    weights = folder / "weights.safetensors"
    save_weights(weights, orange_weights())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench, "seed_plan", one_flight)
        patch.setattr(measure, "SHIPPED", weights)
        found = bench.run(shares.append, folder=folder, report=folder / "report.md", count=1)
    return folder, found, shares


def test_every_method_has_a_row_and_the_refined_one_is_the_nearest(measured) -> None:
    _, found, shares = measured
    rows = {row["method"]: row for row in found["rows"]}
    assert tuple(rows) == kept.ROWS and shares[-1] == 1.0
    for row in (rows[method] for method in kept.METHODS):
        assert 0.8 < row["precision"] <= 1 and 0.8 < row["recall"] <= 1 and row["point_median_mm"] < 10
        assert 0 < row["cpu_p50_ms"] < row["latency_p50_ms"] < row["latency_p99_ms"]
        assert 1000 < row["bytes_per_detection"] < 50_000
    refined = rows["refined"]
    assert refined["error_median_px"] == min(rows[method]["error_median_px"] for method in kept.METHODS) < 0.4
    assert refined["hits_told"] == 1.0 and refined["hit_median_mm"] < 5
    assert refined["error_median_px"] > found_bound(measured), "nobody is better than the bound"


def found_bound(measured) -> float:
    folder, found, _ = measured
    result = kept_result(kept.result_path(folder, found["seeds"][0], "real1", "refined"))
    assert result is not None and len(result.bound_px) > 10
    assert all(a <= b for a, b in zip(result.bound_px, result.pixel_bound_px, strict=True))
    return sorted(result.bound_px)[len(result.bound_px) // 2]


def test_the_pages_have_the_comparisons_and_the_pictures(measured) -> None:
    folder, found, _ = measured
    text, page = (folder / "report.md").read_text(), (folder / "report.html").read_text()
    assert (folder / "images" / "perception-window.png").read_bytes().startswith(b"\x89PNG")
    for words in ("no verdict: recall 0.50", "How it is measured", "`fe-fusion`", "YOLOv4-tiny"):
        assert words in text
    assert len(re.findall("data:image/png;base64,iVBOR", page)) == 1 and "no verdict" in page
    verdicts = [row["verdict"] for row in found["comparisons"]]
    assert verdicts.count("no verdict: recall 0.50 of sharp frames is no rival's") == 4


def test_the_frame_detector_has_a_row_from_the_same_recordings(measured) -> None:
    folder, found, _ = measured
    row = next(row for row in found["rows"] if row["method"] == "yolo")
    stamp = measure.weights_stamp(folder / "weights.safetensors")
    assert stamp is not None
    result = kept_result(kept.frame_result_path(folder, found["seeds"][0], "real1", "yolo", stamp))
    assert result is not None and result.windows == result.frame_bytes / (1280 * 720 * 3) == 10
    assert (result.exposure_us, result.window_us, result.sharp_recall) == (1000, 100_000, 0.5)
    assert row["cpu_p50_ms"] is None or row["latency_p50_ms"] == pytest.approx(0.5 + 8.3 + row["cpu_p50_ms"])


def test_without_weights_the_rows_are_empty_and_the_report_says_why(measured, monkeypatch) -> None:
    folder, found, _ = measured
    monkeypatch.setattr(bench, "seed_plan", one_flight)
    monkeypatch.setattr(measure, "SHIPPED", folder / "no-such-weights")
    again = bench.run(lambda share: None, folder=folder, report=folder / "without.md", count=1)
    row = next(row for row in again["rows"] if row["method"] == "yolo")
    assert row["recall"] is None and row["bytes_per_detection"] is None
    text = (folder / "without.md").read_text()
    assert "`rallyscope train-detector yolo` makes some" in text and comparisons.NOT_MEASURED in text
    assert [one["method"] for one in again["rows"]] == [one["method"] for one in found["rows"]]


def test_what_is_kept_is_not_measured_again_and_a_removed_result_is(measured, monkeypatch) -> None:
    folder, found, _ = measured
    seed = found["seeds"][0]
    asked = []
    monkeypatch.setattr(bench, "measure_method", lambda recording, method: asked.append(method) or again)
    monkeypatch.setattr(measure, "SHIPPED", folder / "weights.safetensors")
    path = kept.result_path(folder, seed, "real1", "paper")
    again = kept_result(path)
    whole = bench.run_seed(one_flight(seed), folder, lambda share: None, with_recordings=False)
    assert asked == [] and len(whole.results) == len(kept.ROWS)
    path.unlink()
    assert bench.run_seed(one_flight(seed), folder, lambda share: None, with_recordings=False) == whole
    assert asked == ["paper"]


def test_a_result_of_another_version_is_not_taken(measured, tmp_path) -> None:
    (tmp_path / "old.json").write_text('{"seed": 7}')
    assert kept_result(tmp_path / "old.json") is None and kept_reading(tmp_path / "old.json") is None


def test_changed_settings_are_another_result_and_the_paper_predicts_by_its_own_rule(monkeypatch, tmp_path) -> None:
    before = kept.result_path(tmp_path, 7, "real1", "refined")
    changed = replace(kept.ChainConfig.of_method("refined"), max_lag_ms=7.0)
    monkeypatch.setattr(kept, "chain_of", lambda method: changed)
    assert kept.result_path(tmp_path, 7, "real1", "refined") != before
    monkeypatch.undo()
    assert kept.chain_of("paper").prediction == "fit" and kept.chain_of("auto").prediction == "filter"


def test_a_seed_is_the_preset() -> None:
    planned = kept.seed_plan(8)
    assert [(one.scene, one.placement) for one in planned.recordings] == [(scene, place) for scene, place, _ in PAPER7]
    assert planned.seed == 8 and all(one.making.frames is not None for one in planned.recordings)
