"""`--plugin FILE.py` and plugins of installed packages, through the verbs: each as a process of its own."""

import ast
import csv
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import split_plugins
from core.config import get_setting
from core.detection.saved import load_detector
from core.errors import CommandError
from core.learning import load_policy, read_run
from core.learning.runs.training import Training
from core.recordings import open_recording
from core.registry import forgotten_afterwards, use_plugins
from labels.model import Label, LabelState
from labels.store import LabelStore
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).parents[3]


def rallyscope(*words: object, code: int = 0, path: Path | None = None, cwd: Path | None = None) -> str:
    """What a verb prints; of one that is to fail, its errors."""
    places = os.pathsep.join(map(str, [ROOT] if path is None else [ROOT, path]))
    done = subprocess.run(
        [sys.executable, "-m", "app.cli", *map(str, words)],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False, cwd=cwd,
        env={**os.environ, "PYTHONPATH": places},
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    return done.stdout if code == 0 else done.stderr


@pytest.fixture
def detector(plugins: Path) -> list[object]:
    return ["--plugin", plugins / "median_detector.py"]


@pytest.fixture
def names(serve_recording: Path) -> list[object]:
    return [serve_recording, "--camera", "left", "--method", "median"]


@pytest.mark.parametrize(
    ("words", "files", "rest"),
    [
        ("detect a.h5 --plugin p.py --out b", ["p.py"], "detect a.h5 --out b"),
        ("--plugin=p.py detect a.h5", ["p.py"], "detect a.h5"),
        ("detect --plugin p.py --plugin q.py", ["p.py", "q.py"], "detect"),
        ("detect -- --plugin p.py", [], "detect -- --plugin p.py"),
        ("detect", [], "detect"),
    ],
)
def test_plugins_may_stand_anywhere(words: str, files: Sequence[str], rest: str) -> None:
    assert split_plugins(words.split()) == ([Path(file) for file in files], rest.split())


@pytest.mark.parametrize("words", ["detect --plugin", "detect --plugin --out b", "detect --plugin="])
def test_a_plugin_without_a_file_is_refused(words: str) -> None:
    with pytest.raises(CommandError, match=r"--plugin without a file"):
        split_plugins(words.split())


@pytest.mark.gate
def test_a_detector_is_a_method_of_detect_and_track(names, detector, serve_recording, tmp_path: Path) -> None:
    found = json.loads(rallyscope("detect", *names, *detector, "--out", tmp_path / "a.csv", "--json"))
    assert found["method"] == "median" and found["score"]["precision"] > 0.9 and found["score"]["recall"] > 0.9
    assert len(list(csv.reader((tmp_path / "a.csv").open()))) == found["detections"] + 1 > 200
    said = rallyscope(*detector, "track", serve_recording, "--method", "median", "--out", tmp_path / "t.csv")
    assert "3D error mm" in said and len((tmp_path / "t.csv").read_text().splitlines()) > 150
    assert "the middle of the events round their median" in " ".join(rallyscope("detect", "--help", *detector).split())
    assert "no method 'median'; expected auto" in rallyscope("detect", *names, "--out", tmp_path / "b.csv", code=2)


def test_it_is_tuned_in_processes_and_its_section_is_used(names, detector, tmp_path: Path) -> None:
    """The pieces go to processes of their own, with a config that holds what the plugin made."""
    start, out = tmp_path / "start.toml", tmp_path / "found.toml"
    start.write_text("[median]\nreach_px = 3.0\nfewest = 5\n")
    words = [*names, *detector, "--config", start, "--trials", 4, "--jobs", 2, "--out", out]
    said = rallyscope("tune", *words, "--parameters", "median.reach_px", "--seed", 2)
    assert "median.reach_px" in said
    with forgotten_afterwards():
        use_plugins([Path(str(detector[1]))])
        found = dict(load_detector(out).config.registered)["median"]
        assert get_setting(found, ("fewest",)) == 5, "through the start, the processes and the answer"
    left_out = rallyscope("detect", *names[:-1], "auto", "--config", out, "--out", tmp_path / "c.csv", code=2)
    assert "unknown setting 'median'" in left_out and "--plugin" in left_out and left_out.count("\n") == 1


def test_it_is_scored_against_labels(names, detector, serve_recording, tmp_path: Path) -> None:
    label_some(serve_recording, tmp_path)
    said = rallyscope("labels", "score", *names, *detector, "--annotator", "ann", "--data", tmp_path, "--json")
    assert json.loads(said)["rows"][0]["at"][-1]["recall"] > 0.8


def label_some(recording_file: Path, data: Path, count: int = 20) -> None:
    """Labels at the truth, in a workspace."""
    with open_recording(recording_file) as recording:
        truth = recording.cameras["left"].truth
        assert truth is not None
        times = 100_000 + 20_000 * np.arange(count)
        places = truth.at(times)
        labels = [
            Label(t_us=int(t), state=LabelState.VISIBLE, x_px=float(u), y_px=float(v), r_px=float(r))
            for t, u, v, r in zip(times, places.u_px, places.v_px, places.r_px, strict=True)
        ]
        (data / "labels").mkdir(parents=True, exist_ok=True)
        with LabelStore.open(data / "labels", recording.uuid, "left", "ann", tool="a test") as store:
            store.edit(put=labels)


def test_a_label_format_writes_and_reads_back(plugins: Path, serve_recording, tmp_path: Path) -> None:
    label_some(serve_recording, tmp_path)
    layer = [serve_recording, "--camera", "left", "--data", tmp_path, "--json"]
    form = ["--format", "json-points", "--plugin", plugins / "json_labels.py"]
    out = tmp_path / "out"
    made = json.loads(rallyscope("labels", "export", *layer, *form, "--annotator", "ann", "--out", out))
    assert made["labels"] == 20 and [path.name for path in out.iterdir()] == ["labels.json"]
    back = json.loads(rallyscope("labels", "import", out, *layer, *form, "--annotator", "bob"))
    assert back["imported"] == 20 and back["rejected"] == []
    refused = rallyscope("labels", "export", *layer, *form[:2], "--annotator", "ann", "--out", out, code=2)
    assert "invalid choice: 'json-points'" in refused


@pytest.mark.gate
def test_a_reader_is_imported_and_opened(plugins: Path, serve_recording, tmp_path: Path) -> None:
    with open_recording(serve_recording) as recording:
        events = recording.cameras["left"].slice(100_000, 200_000)
    rows = np.zeros(len(events), [("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("on", "<u4")])
    rows["t"], rows["x"], rows["y"], rows["on"] = events.t_us - 100_000, events.x_px, events.y_px, events.on
    source = tmp_path / "events.evb"
    source.write_bytes(b"EVB1" + np.array([1280, 720], "<u2").tobytes() + rows.tobytes())
    reader = ["--plugin", plugins / "binary_reader.py"]
    made = json.loads(rallyscope("import", source, tmp_path / "a.h5", *reader, "--json"))
    assert made["events"] == {"camera": len(events)}
    with open_recording(tmp_path / "a.h5") as again:
        assert np.array_equal(again.cameras["camera"].slice(0, 100_000).x_px, events.x_px)
    assert "EVB events" in " ".join(rallyscope("import", "--help", *reader).split())
    assert json.loads(rallyscope("info", source, *reader, "--json"))["cameras"]
    assert "not recognised" in rallyscope("info", source, code=2)


def test_a_reward_trains_in_processes_and_its_settings_are_kept(plugins: Path, tmp_path: Path) -> None:
    reward = ["--plugin", plugins / "smooth_reward.py"]
    config = tmp_path / "config.toml"
    config.write_text('[reward]\nkind = "smooth"\n[reward.smooth]\nwidth_m = 0.25\n')
    run = ["--out", tmp_path / "run"]
    few = ["--speeds", 5, "--episodes", 20, "--seeds", 2, "--jobs", 2, "--json"]
    rallyscope("train", "--config", config, *few, *reward, *run)
    text = (tmp_path / "run" / "config.toml").read_text()
    assert 'kind = "smooth"' in text and "[reward.smooth]\nwidth_m = 0.25\nlost = 0.5\n" in text
    earned = [
        json.loads(line)["reward"]
        for seed in (0, 1)
        for line in (tmp_path / "run" / f"seed-{seed}" / "metrics.jsonl").read_text().splitlines()
    ]
    assert len(earned) == 40 and {-0.5} < set(earned) and all(value == -0.5 or 1 <= value <= 4 for value in earned)
    assert "invalid choice: 'smooth'" in rallyscope("train", "--reward", "smooth", "--out", tmp_path / "b", code=2)
    assert "--plugin" in rallyscope("evaluate", tmp_path / "run", code=2)
    assert json.loads(rallyscope("evaluate", tmp_path / "run", *reward, "--json"))


def test_an_agent_trains_goes_on_as_if_never_stopped_and_its_policy_plays_without_it(plugins: Path, tmp_path) -> None:
    agent, run = ["--plugin", plugins / "regression_agent.py"], tmp_path / "run"
    config = tmp_path / "config.toml"
    config.write_text('agent = "regression"\n[exploration]\nrandom_episodes = 30\n[regression]\nridge = 2.0\n')
    few = ["--speeds", "3,5", "--episodes", 40, "--state-source", "truth", "--replay", "retain"]
    rallyscope("train", "--config", config, *few, *agent, "--out", run)
    text = (run / "config.toml").read_text()
    assert 'agent = "regression"' in text and "[regression]\ntemperature = 0.2\nridge = 2.0\n" in text
    policy = load_policy(run)  # numbers only: nobody needs the plug-in to play it
    assert np.isfinite(policy.act([-1.42, 0, 0.24, -5, 0, 0.9], [0.8, 0.0])).all() and policy.layers[0][0].any()
    assert "invalid choice: 'regression'" in rallyscope("train", "--agent", "regression", "--out", run, code=2)
    with forgotten_afterwards():
        use_plugins([Path(str(agent[1]))])
        whole = Training(read_run(run), 0)
        lines = [whole.play_episode() for _ in range(80)]
        begun = Training(read_run(run), 0)
        assert [begun.play_episode() for _ in range(50)] == lines[:50]
        again = Training.from_checkpoint(read_run(run), 0, *begun.to_checkpoint())
        assert [again.play_episode() for _ in range(30)] == lines[50:]


@pytest.mark.gate
def test_an_exporter_is_a_flag_of_export(plugins: Path, serve_recording, tmp_path: Path) -> None:
    exporter, out = ["--plugin", plugins / "npz_exporter.py"], tmp_path / "events.npz"
    rallyscope("export", serve_recording, "--npz", out, "--start-us", 100_000, "--end-us", 200_000, *exporter)
    with np.load(out) as arrays, open_recording(serve_recording) as recording:
        expected = recording.cameras["right"].slice(100_000, 200_000)
        assert np.array_equal(arrays["right_t_us"], expected.t_us) and len(arrays.files) == 8
    assert "exists already" in rallyscope("export", serve_recording, "--npz", out, *exporter, code=2)
    assert "no such export" in rallyscope("export", tmp_path_run(tmp_path), "--npz", tmp_path / "b", *exporter, code=2)


def tmp_path_run(folder: Path) -> Path:
    (folder / "run").mkdir()
    (folder / "run" / "config.toml").write_text("")
    return folder / "run"


def test_the_shared_contract_tests_take_what_the_environment_names(plugins: Path) -> None:
    names = os.pathsep.join(str(plugins / name) for name in ("median_detector.py", "json_labels.py"))
    suites = ["tests/core/detection/test_contract.py", "tests/labels/formats/test_contract.py"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *suites, "-k", "median or json-points"],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False, cwd=ROOT,
        env={**os.environ, "RALLYSCOPE_PLUGINS": names},
    )  # fmt: skip
    passed = re.search(r"\b(\d+) passed", done.stdout)
    assert done.returncode == 0 and passed is not None and int(passed[1]) >= 19, done.stdout


def test_a_plugin_that_fails_is_one_line_and_exit_2(tmp_path: Path) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("import no_such_module\n")
    said = rallyscope("info", "nothing.h5", "--plugin", bad, code=2)
    assert said.count("\n") == 1 and "bad.py: the plugin raises; got ModuleNotFoundError" in said
    assert "no such file" in rallyscope("info", "--plugin", "missing.py", "nothing.h5", code=2).lower()
    assert "write --plugin in full" in rallyscope("info", "--plug", bad, "nothing.h5", code=2)


def test_an_exporter_with_the_name_of_a_flag_is_refused(plugins: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(
        (plugins / "npz_exporter.py").read_text().replace('register_exporter("npz"', 'register_exporter("json"')
    )
    said = rallyscope("export", "a.h5", "--json", "b", "--plugin", mine, code=2)
    assert said.count("\n") == 1 and "two flags of one name; got argument --json" in said


def test_an_installed_package_adds_a_detector_and_costs_nothing_where_none_is_asked_for(
    plugins: Path, names, tmp_path: Path
) -> None:
    """Its module is imported by verbs that take a method, and by no other."""
    packages, mark = tmp_path / "packages", tmp_path / "imported"
    info = packages / "theirs-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[rallyscope.detectors]\nmedian = their_detector\n")
    module = packages / "their_detector.py"
    text = (plugins / "median_detector.py").read_text()
    module.write_text(f"{text}\nimport pathlib\npathlib.Path({str(mark)!r}).touch()\n")
    rallyscope("--help", path=packages)
    rallyscope("simulate", "--help", path=packages)
    assert not mark.exists()
    said = rallyscope("detect", *names, "--out", tmp_path / "a.csv", path=packages)
    assert "detections in" in said and mark.exists()
    module.write_text("1 / 0")
    broken = rallyscope("detect", *names, "--out", tmp_path / "a.csv", path=packages, code=2)
    assert "theirs, entry point median = their_detector: the plugin raises; got ZeroDivisionError" in broken
    assert broken.count("\n") == 1


def test_only_the_command_line_names_plugins() -> None:
    """No message of a browser, and nothing that a file says, leads to a call that loads one by its path."""
    sources = [path for part in ("app", "core", "labels") for path in (ROOT / part).rglob("*.py")]
    names = {"use_plugins", "load_plugin", "load_same_plugins"}
    calls = {
        (str(path.relative_to(ROOT)), ast.unparse(node.func))
        for path in sources
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in names
    }
    assert {file for file, name in calls if file != "core/registry.py"} == {"app/cli/main.py", "core/jobs/cluster.py"}
