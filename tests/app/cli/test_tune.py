"""`rallyscope tune`, whole."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.cli.tune import held_out_words
from core.config import replace_setting, save_config
from core.detection import DetectorConfig
from core.detection.saved import load_detector
from core.recordings import open_recording
from core.tuning.objective import Figures
from labels.model import Label, LabelState
from labels.store import LabelStore
from tests.waiting import PATIENCE_S

STRICT = replace_setting(DetectorConfig(), ("geometry", "circularity_min"), 0.9)
NAMES = "geometry.circularity_min,localise.radius_min_px"
SIDES = {"tuned", "held_out"}


@pytest.fixture
def strict(tmp_path: Path) -> Path:
    save_config(STRICT, tmp_path / "strict.toml")
    return tmp_path / "strict.toml"


def tune(recording: Path, out: Path, *more: object) -> int:
    return main(["tune", str(recording), "--out", str(out), "--trials", "9", "--jobs", "1", *map(str, more)])


@pytest.mark.gate
def test_the_config_is_better_than_the_one_it_started_from_and_detect_takes_it(
    serve_recording: Path, strict: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "found.toml"
    assert tune(serve_recording, out, "--config", strict, "--parameters", NAMES, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["cameras"] == ["left", "right"] and report["trials"] == report["asked"] == 9
    assert report["start"].keys() == report["best"].keys() == SIDES
    start, best = report["start"]["tuned"], report["best"]["tuned"]
    assert start.keys() == {"precision", "recall", "median_error_px", "objective", "balls"}
    assert best["objective"] > start["objective"] and len(report["history"]) == 9
    before, after = report["changed"]["geometry.circularity_min"]
    assert before == 0.9 and load_detector(out).config.geometry.circularity_min == after
    assert set(report["importance"]) == set(NAMES.split(","))
    assert report["better_held_out"] is (
        report["best"]["held_out"]["objective"] > report["start"]["held_out"]["objective"]
    )
    f1 = []
    for config in (strict, out):
        arguments = ["--camera", "left", "--config", str(config), "--json"]
        assert main(["detect", str(serve_recording), "--out", str(tmp_path / "ball.csv"), *arguments]) == 0
        f1.append(json.loads(capsys.readouterr().out)["score"]["f1"])
    assert f1[1] > f1[0]


def test_in_time_it_says_so_and_labels_cannot_be_asked(
    serve_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, few = tmp_path / "a.toml", ("--trials", "2", "--method", "auto", "--parameters", NAMES, "--camera", "left")
    asked = ("--streaming", "--delay-us", "3000")
    assert tune(serve_recording, out, *few, *asked, "--json") == 0
    late = json.loads(capsys.readouterr().out)
    assert late["added_us"] == 3000 and 0 < late["start"]["tuned"]["recall"] <= 1
    assert tune(serve_recording, out, *few, *asked, "--against", "labels", "--data", tmp_path) == 2
    assert "--streaming" in capsys.readouterr().err


def test_windows_may_end_early_and_are_named_but_not_against_labels(
    serve_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, few = tmp_path / "a.toml", ("--trials", "2", "--method", "auto", "--parameters", NAMES, "--camera", "left")
    early = ("--window-px", "1", "--window-events", "900")
    assert tune(serve_recording, out, *few, *early) == 0
    assert "windows that end after 900 events or 1 px of motion" in capsys.readouterr().out
    assert tune(serve_recording, out, *few, *early, "--against", "labels", "--data", tmp_path) == 2
    assert "--window-events" in capsys.readouterr().err


def test_a_person_reads_both_sides_what_changed_and_whether_it_holds(
    serve_recording: Path, strict: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        tune(serve_recording, tmp_path / "a.toml", "--config", strict, "--parameters", NAMES, "--camera", "left") == 0
    )
    text = capsys.readouterr().out
    for words in ("tuned on", "held out", "precision", "geometry.circularity_min", "importance", "a.toml"):
        assert words in text
    assert "On the held-out windows it is" in text


def test_where_nothing_is_better_it_says_so_and_keeps_the_start(
    serve_recording: Path, strict: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "same.toml"
    assert tune(serve_recording, out, "--config", strict, "--camera", "left", "--trials", "1") == 0
    assert "Nothing better was found" in capsys.readouterr().out and load_detector(out) == ("auto", STRICT)


def test_labels_are_as_good_as_the_truth_to_tune_against(
    serve_recording: Path, strict: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "data"
    with open_recording(serve_recording) as recording:
        truth, uuid = recording.cameras["left"].truth, recording.uuid
    assert truth is not None
    at = truth.at(np.arange(100_000, 590_000, 10_000))
    with LabelStore.open(data / "labels", uuid, "left", "anna") as store:
        rows = zip(at.t_us.tolist(), at.u_px.tolist(), at.v_px.tolist(), at.visible, strict=True)
        store.edit(put=[Label(t_us=t, state=LabelState.VISIBLE, x_px=u, y_px=v) for t, u, v, seen in rows if seen])
    common = ["--config", strict, "--parameters", NAMES, "--against", "labels", "--data", data, "--json"]
    assert tune(serve_recording, tmp_path / "l.toml", *common) == 0
    report = json.loads(capsys.readouterr().out)
    assert (
        report["against"] == "labels" and report["best"]["tuned"]["objective"] > report["start"]["tuned"]["objective"]
    )
    assert tune(serve_recording, tmp_path / "l.toml", *common, "--annotator", "bea") == 2
    assert "no labels by 'bea'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--parameters", "cluster.nonsense"], "expected one of"),
        (["--method", "magic"], "magic"),
        (["--camera", "middle"], "middle"),
        (["--against", "labels", "--data", "nowhere"], "no labels of cameras 'left', 'right'"),
        (["--annotator", "anna"], "--against labels"),
        (["--seed", "-1"], "seed"),
        (["--trials", "0"], "trials"),
        (["--config", "no-such.toml"], "no-such.toml"),
        (["--out", "no/such/folder.toml"], "no such folder"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(
    serve_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    assert tune(serve_recording, tmp_path / "o.toml", *arguments) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert not (tmp_path / "o.toml").exists()


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_polite_end_leaves_the_best_so_far(serve_recording: Path, tmp_path: Path, jobs: str) -> None:
    out = tmp_path / "best.toml"
    command = [
        sys.executable,
        "-m",
        "app.cli",
        "tune",
        str(serve_recording),
        "--out",
        str(out),
        "--json",
        "--until-eof",
    ]
    child = subprocess.Popen(
        [*command, "--trials", "100000", "--jobs", jobs], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    while "best" not in (line := child.stdout.readline()):
        assert line, "it ended by itself"
    child.send_signal(signal.SIGINT)
    *_, last = child.communicate(timeout=PATIENCE_S)[0].splitlines()
    assert child.returncode == 0
    report = json.loads(last)
    assert report["stopped"] and 1 <= report["trials"] < report["asked"]
    assert load_detector(out).method == "refined"


def test_it_ends_with_its_parent(serve_recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "best.toml"
    command = [sys.executable, "-m", "app.cli", "tune", str(serve_recording), "--out", str(out), "--until-eof"]
    child = subprocess.Popen(
        [*command, "--trials", "100000", "--jobs", "1"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdin is not None and child.stdout is not None
    child.stdout.readline()
    child.stdin.close()
    child.stdout.read()
    assert child.wait(timeout=PATIENCE_S) == 0
    with pytest.raises(ProcessLookupError):
        os.kill(child.pid, 0)


def test_what_was_found_is_said_even_if_it_cannot_be_written(
    serve_recording: Path, strict: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken.toml").mkdir()
    more = ("--config", strict, "--camera", "left", "--trials", "1")
    assert tune(serve_recording, tmp_path / "taken.toml", *more) == 2
    said = capsys.readouterr()
    assert "Nothing better was found" in said.out and "the config:" not in said.out
    assert "cannot write the config; got Is a directory; free some space" in said.err


@pytest.mark.parametrize(
    ("after", "says"),
    [
        (0.9971, "there is no measurable difference: 0.9970 before, 0.9971 now."),
        (0.9985, "it is better, too: 0.9970 before, 0.9985 now."),
        (0.99, "it is NOT better: 0.9970 before, 0.9900 now."),
    ],
)
def test_the_verdict_calls_nothing_better_that_reads_alike(after: float, says: str) -> None:
    before = Figures(1.0, 1.0, 0.13, 0.997, balls=2184)
    assert says in held_out_words(before, replace(before, objective=after))
