"""The short tests and those of Rerun files with the oldest versions that pyproject.toml allows: `make lowest`.

An environment in build/lowest is made anew: each dependency in the oldest version that its bound allows (uv's
resolution `lowest-direct`), what those need in the newest that fits, and the tools of the tests. Tests of extras that
are not there are left out.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
FOLDER: Final = ROOT / "build" / "lowest"
TOOLS: Final = (
    "hypothesis",
    "matplotlib",
    "psutil",
    "pytest",
    "pytest-rerunfailures",
    "pytest-timeout",
    "pytest-xdist",
)
"""What the tests need beside the package; matplotlib draws the reports of `evaluate`."""
LEFT_OUT: Final = (
    "tests/app/browser",
    "tests/app/cli/test_record.py",
    "tests/app/cli/test_serve_cameras.py",
    "tests/app/cli/test_tune.py",
    "tests/app/export/test_onnx_actor.py",
    "tests/core/data_sets/test_index.py",
    "tests/core/devices/test_neuromorphic.py",
    "tests/core/devices/test_raw_recorder.py",
    "tests/core/jobs/test_cluster.py",
    "tests/core/learning/runs/test_sb3_baselines.py",
    "tests/core/learning/test_gym_environment.py",
    "tests/core/live/test_camera_source.py",
    "tests/core/recordings/test_import_facts.py",
    "tests/core/tuning/test_search.py",
    "tests/core/tuning/test_tune.py",
    "tests/docs",
    "tests/labels/balls/test_table.py",
    "tests/labels/formats/test_independent_readers.py",
    "tests/strangers",
    "tests/test_dependencies.py",
)
"""Tests of extras, of other people's tools and of a browser: they import what this environment has not. What declares
its dependencies is looked up among the packages of `dev`.
"""
SLOW_TOO: Final = ("tests/app/export/rrd",)
"""Rerun changes its interface with each version, and its tests are slow ones."""


def main() -> int:
    """Make the environment and run the tests; the exit code of pytest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", default="3.11", help="the oldest that is supported")
    parser.add_argument("--torch-index", help="where torch alone comes from, such as its index of CPU builds")
    parser.add_argument("--only-install", action="store_true")
    parser.add_argument("tests", nargs="*", help="files for pytest; all short tests by default")
    arguments = parser.parse_args()
    make_environment(arguments.python, arguments.torch_index)
    if arguments.only_install:
        return 0
    chosen = arguments.tests or [f"--ignore={path}" for path in LEFT_OUT]
    pytest = [str(python()), "-m", "pytest", "-q", "-n", "2", "--dist", "loadscope"]
    done = subprocess.run([*pytest, "-m", "not slow", *chosen], cwd=ROOT, check=False).returncode
    if done or arguments.tests:
        return done
    return subprocess.run([*pytest, "-m", "slow", *SLOW_TOO], cwd=ROOT, check=False).returncode


def make_environment(version: str, torch_index: str | None) -> None:
    """Resolve and install; the versions are in `build/lowest.txt` afterwards."""
    FOLDER.parent.mkdir(exist_ok=True)
    pins = FOLDER.with_suffix(".txt")
    wanted = ["pyproject.toml", "--resolution", "lowest-direct", "--python-version", version, "--only-binary", ":all:"]
    uv("pip", "compile", *wanted, "--no-emit-index-url", "--no-header", "--no-annotate", "--output-file", str(pins))
    uv("venv", "--clear", "--python", version, str(FOLDER))
    if torch_index:
        lines = pins.read_text(encoding="utf-8").splitlines()
        torch = next(line for line in lines if line.startswith("torch=="))
        install("--no-deps", "--default-index", torch_index, torch)
        # what a build with CUDA alone needs
        others = [line for line in lines if not line.startswith(("torch==", "nvidia-", "triton=="))]
        pins.write_text("\n".join(others) + "\n", encoding="utf-8")
    install("--only-binary", ":all:", "--requirement", str(pins), *TOOLS)
    install("--no-deps", "--editable", ".")


def install(*words: str) -> None:
    """Install into the environment."""
    uv("pip", "install", "--python", str(python()), *words)


def uv(*words: str) -> None:
    """Run uv of this environment, quietly."""
    subprocess.run([str(Path(sys.executable).with_name("uv")), *words, "--quiet"], cwd=ROOT, check=True)


def python() -> Path:
    """The environment's Python."""
    return FOLDER / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


if __name__ == "__main__":
    sys.exit(main())
