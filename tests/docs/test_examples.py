"""The scripts under docs/examples and the code of docs/use/python-api.md run, and print what they should."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from core.cameras import load_calibration
from core.chain import true_positions
from core.data_sets import plan_data_set, run_data_set
from core.data_sets.plan import Making
from core.events import SensorSize
from core.recordings import open_recording
from labels import LabelStore
from tests.sizes import BROWSER_TIMEOUT_S
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
PAGE = (ROOT / "docs" / "use" / "python-api.md").read_text(encoding="utf-8")
DATA_SET_PAGE = (ROOT / "docs" / "use" / "data-sets.md").read_text(encoding="utf-8")
BLOCKS, DATA_SET_BLOCKS = (re.findall(r"```python\n(.*?)```", page, re.DOTALL) for page in (PAGE, DATA_SET_PAGE))


def run_script(script: Path, *arguments: object, folder: Path | None = None) -> str:
    done = subprocess.run(
        [sys.executable, str(script), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        cwd=folder or ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def numbers(text: str, pattern: str) -> list[float]:
    found = re.search(pattern, text)
    assert found, f"no {pattern!r} in:\n{text}"
    return [float(group) for group in found.groups()]


def test_detect_finds_the_ball_in_most_windows(serve_recording: Path) -> None:
    said = run_script(EXAMPLES / "detect.py", serve_recording)
    for camera in ("left", "right"):
        events, balls, windows = numbers(said, rf"{camera}: (\d+) events, (\d+) balls in (\d+) windows")
        assert events > 100_000
        assert windows == 300
        assert 200 < balls <= 300
    assert len(re.findall(r"^  \d+ us: x [\d.]+ px, y [\d.]+ px$", said, re.MULTILINE)) == 6


def test_detect_makes_its_own_input_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    assert numbers(run_script(EXAMPLES / "detect.py"), r"right: \d+ events, (\d+) balls")[0] > 200
    assert not list(tmp_path.iterdir())


def test_prediction_meets_the_hitting_plane(serve_recording: Path) -> None:
    said = run_script(EXAMPLES / "triangulate_and_predict.py", serve_recording)
    points, residual_px = numbers(said, r"(\d+) points in space, median residual ([\d.]+) px")
    assert points > 150
    assert residual_px < 1.0
    assert numbers(said, r"median error ([\d.]+) mm")[0] < 10
    x_m, in_ms = numbers(said, r"at x (-[\d.]+) m in (\d+) ms")
    assert x_m == -1.42
    assert 100 < in_ms < 500
    y_m, sigma_y_m, z_m, sigma_z_m = numbers(said, r"y (-?[\d.]+) m \+- ([\d.]+), z ([\d.]+) m \+- ([\d.]+)")
    assert abs(y_m) < 0.6
    assert 0.0 < z_m < 0.6
    assert 0 < sigma_y_m < 0.05
    assert 0 < sigma_z_m < 0.05


def test_a_scene_is_simulated_with_its_truth(tmp_path: Path) -> None:
    out = tmp_path / "scene.h5"
    said = run_script(EXAMPLES / "simulate_scene.py", out, "dark", "320x180")
    seconds, visible = numbers(said, r"scene\.h5: ([\d.]+) s, the ball is visible (\d+) times")
    assert 0.5 < seconds < 1.5
    assert visible > 200
    assert numbers(said, r"left: (\d+) events")[0] > 10_000
    assert out.is_file()


def test_an_own_detector_is_scored_beside_the_built_in_one(serve_recording: Path) -> None:
    said = run_script(EXAMPLES / "own_detector.py", serve_recording)
    pattern = r"precision ([\d.]+), recall ([\d.]+), ([\d.]+) px"
    own, built_in = numbers(said, f"median: {pattern}"), numbers(said, f"auto: {pattern}")
    assert own[0] > 0.2
    assert built_in[0] > max(0.95, own[0])
    assert own[1] > 0.2
    assert built_in[1] > 0.95
    assert built_in[2] < min(2.0, own[2])


def test_a_policy_is_trained_and_evaluated(tmp_path: Path) -> None:
    said = run_script(EXAMPLES / "train_and_evaluate.py", tmp_path / "run", 30)
    assert "run: finished" in said
    speed, balls, returned = numbers(said, r"([\d.]+) m/s, (\d+) balls: ([\d.]+) % returned")
    assert (speed, balls) == (5, 200)
    assert 20 < returned <= 100
    assert (tmp_path / "run" / "seed-0" / "policy.safetensors").is_file()


def test_labels_come_back_as_they_went_out(serve_recording: Path) -> None:
    said = run_script(EXAMPLES / "labels_in_and_out.py", serve_recording)
    (stored,) = numbers(said, r"(\d+) labels are on the disk")
    back, rejected, moved_px = numbers(said, r"(\d+) labels came back, (\d+) rejected, at most ([\d.]+) px moved")
    assert stored == back > 20
    assert rejected == 0
    assert moved_px < 0.001
    recall, error_px = numbers(said, r"recall ([\d.]+), median error ([\d.]+) px")
    assert recall > 0.9
    assert error_px < 2


def test_four_cameras_are_imported_calibrated_labelled_tracked_and_exported(tmp_path: Path) -> None:
    """The rig is calibrated from the recording; points are made of more than two cameras, and the table says of which.

    Poses are as good as the points: the truth is in the table's frame, which the clicked corners give.
    """
    done = subprocess.run(
        ["bash", str(EXAMPLES / "four_cameras.sh"), str(tmp_path / "out")],
        capture_output=True, text=True, timeout=PATIENCE_S, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "RALLYSCOPE": f"{sys.executable} -m app.cli"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    out = tmp_path / "out"
    with open_recording(out / "simulated.h5") as simulated, open_recording(out / "rally.h5") as rally:
        truth, names = simulated.ball, set(simulated.cameras)
        assert truth is not None and set(rally.cameras) == names and len(names) == 4
        first_us = min(int(camera.slice(0, 100_000).t_us[0]) for camera in simulated.cameras.values())
    lines = [line.split(",") for line in (out / "track.csv").read_text().splitlines()[1:]]
    used = [set(line[4].split("+")) for line in lines]
    assert set().union(*used) == names and sum(len(one) > 2 for one in used) > 0.5 * len(used) > 100
    rows = np.array([[float(value) for value in line[:4]] for line in lines])
    seen = true_positions(truth, (rows[:, 0] + first_us).astype(np.int64))
    errors_m = np.linalg.norm(rows[:, 1:] - seen, axis=1)
    assert np.nanmedian(errors_m) < 0.0006
    given, found = (load_calibration(path) for path in (EXAMPLES / "corners.toml", out / "rig.toml"))
    assert found.keys() == given.keys() == names
    for name in names:
        assert not np.array_equal(found[name].T_world_camera, given[name].T_world_camera), "calibrated anew"
        assert np.linalg.norm(found[name].position_world_m - given[name].position_world_m) < 0.002
    folder = out / "labels" / "labels"
    with open_recording(out / "rally.h5") as rally, LabelStore.open(folder, rally.uuid, "far_left", "me") as kept:
        assert len(kept.all()) > 15
    assert (out / "rally.rrd").stat().st_size > 100_000


@pytest.mark.gate
@pytest.mark.timeout(BROWSER_TIMEOUT_S)  # eight programs one after another, each of which loads all it needs
def test_a_stereo_pair_goes_from_event_files_to_a_prediction(tmp_path: Path) -> None:
    """The verbs read what the others write; the prediction is held against the truth, which they did not see."""
    done = subprocess.run(
        ["bash", str(EXAMPLES / "stereo_pair.sh"), str(tmp_path / "out")],
        capture_output=True, text=True, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "RALLYSCOPE": f"{sys.executable} -m app.cli"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    out = tmp_path / "out"
    with open_recording(out / "simulated.h5") as simulated, open_recording(out / "pair.h5") as pair:
        truth = simulated.ball
        assert truth is not None and pair.ball is None
        assert sum(camera.event_count for camera in pair.cameras.values()) > 500_000
        first_us = min(int(camera.slice(0, 100_000).t_us[0]) for camera in simulated.cameras.values())
    for camera in ("left", "right"):
        assert len((out / f"ball-{camera}.csv").read_text().splitlines()) > 300
    t_us, *p = np.loadtxt(out / "track.csv", delimiter=",", skiprows=1, usecols=range(4)).T
    seen = true_positions(truth, (t_us + first_us).astype(np.int64))
    assert np.nanmedian(np.linalg.norm(np.transpose(p) - seen, axis=1)) < 0.003
    plane = json.loads((out / "prediction.json").read_text())["hit_plane"]
    after = np.flatnonzero(truth.visible & (truth.p_world_m[:, 0] < -1.42))[0]
    passed_s = 1e-6 * (truth.t_us[after] - first_us)
    assert plane["t_s"] == pytest.approx(passed_s, abs=0.01)
    np.testing.assert_allclose(plane["p_world_m"][1:], truth.p_world_m[after, 1:], atol=0.02)
    assert (out / "pair.rrd").stat().st_size > 100_000


def test_the_code_of_the_page_runs(serve_recording: Path, tmp_path: Path) -> None:
    shutil.copy(serve_recording, tmp_path / "recording.h5")
    script = tmp_path / "page.py"
    script.write_text("\n".join(BLOCKS), encoding="utf-8")
    said = run_script(script, folder=tmp_path)
    assert "['left', 'right']" in said
    assert re.search(r"^Detection\(t_us=\d+, u_px=", said, re.MULTILINE)
    assert re.search(r"^\d+ pre [\d.]+ \[-1\.42 ", said, re.MULTILINE)


def test_a_network_could_be_trained_on_a_data_set_as_its_page_says(tmp_path: Path) -> None:
    making = Making(sensor=SensorSize(640, 360))
    plan = plan_data_set(speeds_mps=(8, 9), recordings_per=2, serves=1, robot=False, making=making)
    run_data_set(plan, tmp_path / "sets" / "speeds")
    script = tmp_path / "page.py"
    selected = ["sets/speeds", "--balls", "--where", "kind=bounce speed_mps=6..", "--data-set", "sets/fast-bounces"]
    subprocess.run(
        [sys.executable, "-m", "app.cli", "info", *selected],
        check=True, timeout=PATIENCE_S, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    script.write_text("\n".join([*DATA_SET_BLOCKS, 'print("windows", len(train))']), encoding="utf-8")
    said = run_script(script, folder=tmp_path)
    batches = re.findall(r"^torch.Size\(\[32, 2, 360, 640\]\) tensor\(\[ *(\d+\.\d+), ", said, re.MULTILINE)
    assert len(batches) >= 5 and all(0 <= float(u) < 640 for u in batches)
    assert numbers(said, r"windows (\d+)")[0] > 50  # of the flights that were selected


@pytest.mark.parametrize("code", [*(path.read_text() for path in EXAMPLES.glob("*.py")), *BLOCKS, *DATA_SET_BLOCKS])
def test_nothing_is_imported_from_deeper_than_a_room(code: str) -> None:
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom):
            assert node.module is not None
            top, *rooms = node.module.split(".")
            assert len(rooms) == {"core": 1, "labels": 0}.get(top, len(rooms)), node.module


def test_the_page_links_every_example() -> None:
    for path in EXAMPLES.glob("*.py"):
        if path.stem != "small_input":
            assert f"(../examples/{path.name})" in PAGE
