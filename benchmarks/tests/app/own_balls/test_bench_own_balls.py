"""The bench on a simulated recording that two people "labelled": the truth and noise, so that the figures are known."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from benchmarks.perception.results import METHODS
from core.cameras import stereo_preset
from core.metrics.grid_score import askable
from core.recordings import open_recording
from core.simulation import LaunchConfig, StereoConfig, simulate_recording
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore

SIGMA_PX = 0.3
SERVES = 4
BY_HAND, ACCEPTED = Provenance(source=PositionSource.BY_HAND), PositionSource.ACCEPTED


@dataclass(frozen=True)
class Lab:
    recordings: Path
    data: Path
    uuid: str
    labels: int
    """Of anna."""
    common: int
    """That ben made too."""


def labels_of(stream, sigma_px: float, rng: np.random.Generator, step_us: int) -> list[Label]:
    """Of a person who is that exact, wherever a detector can be asked; every third an accepted proposal."""
    truth = stream.truth
    grid = np.arange(truth.t_us[0], truth.t_us[-1], step_us)
    at = truth.at(grid[askable(grid, truth, stream.sensor)])
    off = rng.normal(0, sigma_px, (len(at.t_us), 2))
    made = []
    for row, t_us in enumerate(at.t_us.tolist()):
        made_how = Provenance(source=ACCEPTED, detector="auto#0123456789ab") if row % 3 == 0 else BY_HAND
        x, y = float(at.u_px[row] + off[row, 0]), float(at.v_px[row] + off[row, 1])
        made.append(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=x, y_px=y, provenance=made_how))
    return made


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Lab:
    folder = tmp_path_factory.mktemp("own")
    path = folder / "balls" / "day2-01.h5"
    path.parent.mkdir()
    simulate_recording(path, StereoConfig(), stereo_preset(), [LaunchConfig(speed_mps=9.0)] * SERVES, seed=4)
    rng = np.random.default_rng(7)
    labels = common = 0
    with open_recording(path) as recording:
        uuid = recording.uuid
        for name, stream in recording.cameras.items():
            mine = labels_of(stream, SIGMA_PX, rng, 4000)
            theirs = labels_of(stream, SIGMA_PX, rng, 4000)[::4]
            nothing = Label(t_us=mine[0].t_us - 40_000, state=LabelState.NO_BALL)
            with LabelStore.open(folder / "data" / "labels", uuid, name, "anna") as store:
                store.edit(put=[nothing, *mine])
            with LabelStore.open(folder / "data" / "labels", uuid, name, "ben") as store:
                store.edit(put=theirs)
            labels += 1 + len(mine)
            common += len(theirs)
    return Lab(path.parent, folder / "data", uuid, labels, common)


def bench(capsys, *words: object) -> tuple[int, str, str]:
    code = main(["bench", "paper-perception", *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


def test_every_method_is_scored_against_each_annotator_and_the_figures_are_those_that_were_made(
    lab: Lab, capsys
) -> None:
    code, out, _ = bench(capsys, "--recorded", lab.recordings, "--data", lab.data, "--json")
    assert code == 0
    told = json.loads(out)
    rows = {(row["annotator"], row["group"], row["method"]): row for row in told["rows"]}
    assert {key[2] for key in rows} == set(METHODS) and {key[0] for key in rows} == {"anna", "ben"}
    assert {key[1] for key in rows} == {"all", "by hand", "accepted"}
    refined = rows["anna", "all", "refined"]
    assert (refined["labels"], refined["balls"]) == (lab.labels, SERVES)
    assert refined["precision"] > 0.98 and refined["recall"] > 0.98
    # of an exact detector the distances would be those of the labels' noise: Rayleigh's median and 95th percentile
    assert 1.18 * SIGMA_PX < refined["error_median_px"] < 1.5 * SIGMA_PX
    assert 2.4 * SIGMA_PX < refined["error_p95_px"] < 3.5 * SIGMA_PX
    for name in ("error_median", "error_p95"):
        assert refined[f"{name}_low_px"] < refined[f"{name}_px"] < refined[f"{name}_high_px"]
    assert refined["error_median_px"] < rows["anna", "all", "fe-fusion"]["error_median_px"]
    for row in told["rows"]:
        assert row["precision_low"] <= row["precision"] <= row["precision_high"]
        assert 0 < row["cpu_p50_ms"] <= row["cpu_p99_ms"]
    share = 1.96**2  # Wilson's lower end when all of N are found: N / (N + z^2); balls are counted, not labels
    whole = next(row for row in told["rows"] if row["recall"] == 1.0)
    assert whole["recall_low"] == pytest.approx(SERVES / (SERVES + share), abs=1e-9)


def test_two_who_agree_to_their_noise_stand_beside_it_and_the_card_counts_what_was_made(
    lab: Lab, capsys, tmp_path
) -> None:
    page = tmp_path / "own.md"
    where = ("--recorded", lab.recordings, "--data", lab.data, "--only", "auto", "--report", page)
    code, out, _ = bench(capsys, *where, "--json")
    assert code == 0
    told = json.loads(out)
    (pair,) = told["agreement"]
    assert (pair["first"], pair["second"], pair["common"]) == ("anna", "ben", lab.common)
    assert pair["sigma_px"] == pytest.approx(SIGMA_PX, rel=0.25)
    card = told["card"]
    assert card["labels"] == lab.labels + lab.common and card["annotators"]["anna"]["labels"] == lab.labels
    by = card["annotators"]["anna"]["by_source"]
    assert by["accepted"] + by["by hand"] == lab.labels and by["accepted"] > 10
    assert card["annotators"]["anna"]["by_state"]["no_ball"] == 2
    assert list(card["proposed_by"]) == ["auto#0123456789ab"]
    assert any("favour the detector that made them" in remark for remark in told["remarks"])
    assert [one["recording"] for one in told["recordings"]] == ["day2-01.h5", "day2-01.h5"]
    text = page.read_text()
    for words in ("| anna | by hand |", "`auto`", "accepted proposals of auto#0123456789ab", "lenses", "day2-01.h5"):
        assert words in text


def test_it_says_the_same_as_labels_score(lab: Lab, capsys) -> None:
    where = ("--recorded", lab.recordings / "day2-01.h5", "--data", lab.data, "--annotator", "ben", "--only", "paper")
    _, out, _ = bench(capsys, *where, "--json")
    bench_rows = json.loads(out)["recordings"]
    scores = []
    for camera in ("left", "right"):
        verb = ["labels", "score", str(lab.recordings / "day2-01.h5"), "--camera", camera, "--annotator", "ben"]
        assert main([*verb, "--method", "paper", "--data", str(lab.data), "--json"]) == 0
        scores.append(json.loads(capsys.readouterr().out)["rows"][0])
    (row,) = bench_rows
    found = sum(score["at"][-1]["recall"] * score["with_ball"] for score in scores)
    assert row["recall"] == pytest.approx(found / sum(score["with_ball"] for score in scores))
    assert min(s["median_px"] for s in scores) <= row["error_median_px"] <= max(s["median_px"] for s in scores)


def test_what_cannot_be_scored_is_one_line(lab: Lab, capsys, tmp_path) -> None:
    refused = {
        "no recordings": ("--recorded", tmp_path, "--data", lab.data),
        "no labels of these recordings": ("--recorded", lab.recordings, "--data", tmp_path),
        "no labels by 'carl'": ("--recorded", lab.recordings, "--data", lab.data, "--annotator", "carl"),
        "no method 'best'": ("--recorded", lab.recordings, "--data", lab.data, "--only", "best"),
        "no such option; got --annotator": ("--annotator", "anna"),
    }
    for words, flags in refused.items():
        code, _, err = bench(capsys, *flags)
        assert code == 2 and words in err and err.count("\n") == 1, err


def test_a_copy_of_a_recording_does_not_count_twice(lab: Lab, capsys, tmp_path) -> None:
    for name in ("a.h5", "b.h5"):
        (tmp_path / name).write_bytes((lab.recordings / "day2-01.h5").read_bytes())
    code, _, err = bench(capsys, "--recorded", tmp_path, "--data", lab.data)
    assert code == 2 and "the same recording twice; got a.h5 and b.h5" in err
