"""Without the packages of the extras the package works, and what needs one says which in one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from core.extras import EXTRAS, missing_package, require_package
from tests.test_other_systems import HELP, LABELS, PLAIN, SIMULATE, WORK
from tests.waiting import PATIENCE_S

ROOT = Path(__file__).parents[1]
HIDE = f"""
import sys
class Hiding:
    def __init__(self, finder):
        self.finder = finder
    def __getattr__(self, name):
        return getattr(self.finder, name)
    def find_spec(self, name, path=None, target=None):
        hidden = name.partition(".")[0] in {sorted(EXTRAS)!r}
        return None if hidden else self.finder.find_spec(name, path, target)
sys.meta_path[:] = map(Hiding, sys.meta_path)
"""
"""Every process that is started so finds none of the extras, as if they were not installed."""
ONE = [*SIMULATE, "--frames-hz", "30", "--out", "one.h5"]
LEFT_OUT = ("train", "--csv", "set")
"""What of the plain work needs an extra."""
LACKING = [
    (["train", "--speeds", "5", "--episodes", "8", "--out", "run"], "torch"),
    (["train-detector", "yolo", "--out", "weights.safetensors"], "torch"),
    (["detect", "one.h5", "--camera", "left", "--method", "yolo", "--out", "yolo.csv"], "torch"),
    (["simulate", "--robot", "--serves", "1", "--out", "robot.h5"], "mujoco"),
    (["simulate", "--speeds", "8", "--no-robot", "--out", "set"], "pyarrow"),
    (["sim-server", "--bind", "tcp://127.0.0.1:0"], "mujoco"),
    (["export", "one.h5", "--rrd", "one.rrd"], "rerun"),
    (["export", "one.h5", "--csv", "columns"], "pyarrow"),
    (["info", "one.h5", "--balls"], "pyarrow"),
    (["export", "run", "--mp4", "run.mp4"], "av"),
]


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment of a process without the extras."""
    folder = tmp_path_factory.mktemp("light")
    (folder / "sitecustomize.py").write_text(HIDE, encoding="utf-8")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}


def run(environment: dict[str, str], folder: Path, *command: str) -> str:
    words = [sys.executable, "-c", *command]
    done = subprocess.run(
        words, cwd=folder, capture_output=True, encoding="utf-8", env=environment, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:] or done.stdout[-3000:]
    return done.stderr


@pytest.mark.gate
def test_every_verb_starts_and_the_app_loads(light: dict[str, str], tmp_path: Path) -> None:
    hidden = f"\nfor name in {sorted(EXTRAS)!r}:\n    try:\n        __import__(name)\n    except ImportError:\n"
    run(light, tmp_path, f"{HELP}{hidden}        continue\n    raise AssertionError(name)")


def test_the_plain_work_is_done(light: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_text(LABELS, encoding="utf-8")
    lines = [line for line in PLAIN if not set(LEFT_OUT) & set(line) and "cd.dat" not in line]
    assert len(lines) >= 7
    run(light, tmp_path, WORK, json.dumps(lines))


def test_what_needs_an_extra_says_which_in_one_line(light: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.toml").touch()
    lacking = """
for line in json.loads(sys.argv[2]):
    print("::", *line, file=sys.stderr, flush=True)
    assert main(line) == 2, line
"""
    lines = [line for line, _ in LACKING]
    said = run(light, tmp_path, WORK + lacking, json.dumps([ONE]), json.dumps(lines)).split(":: ")[1:]
    for (line, package), text in zip(LACKING, said, strict=True):
        (message,) = [row for row in text.splitlines() if row.startswith("rallyscope: ")]
        assert f"needs {package}, which is not installed; pip install 'rallyscope[{EXTRAS[package]}]'" in message, line
        assert "Traceback" not in text


def test_a_recording_is_served(light: dict[str, str], tmp_path: Path) -> None:
    run(light, tmp_path, WORK, json.dumps([ONE]))
    words = [sys.executable, "-m", "app.cli", "serve", "one.h5", "--port", "0", "--data", "data"]
    with subprocess.Popen(
        words, cwd=tmp_path, env=light, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8"
    ) as server:
        try:
            assert server.stdout is not None
            said = next(line for line in server.stdout if "http://" in line)
            address = said.partition("http://")[2].split()[0]
            with urllib.request.urlopen(f"http://{address}/", timeout=PATIENCE_S) as answer:
                assert b"Rallyscope" in answer.read()
        finally:
            server.terminate()


def test_only_an_import_of_an_extra_is_a_missing_package() -> None:
    assert missing_package(ModuleNotFoundError("no", name="another")) is None
    assert missing_package(ImportError("no", name="torch")) is None and missing_package(ValueError("torch")) is None
    named = missing_package(ModuleNotFoundError("no", name="pyarrow.csv"))
    assert named is not None and "'rallyscope[data]'" in str(named)
    require_package("numpy", "this")
