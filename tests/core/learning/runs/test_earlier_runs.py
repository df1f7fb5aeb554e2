"""Runs of version 0.1, whose networks and optimiser were written out by hand, are gone on with.

`tests/fixtures/runs` has them as that version left them, one seed stopped on the way; `continued.jsonl` is what it made
of that seed when it went on. That policies of that version play as they did is in `test_files_of_earlier_versions.py`.
"""

import shutil
from pathlib import Path

import pytest

from core.learning.runs.run_files import read_lines, seed_files
from core.learning.runs.running import run_training

pytestmark = pytest.mark.numeric
RUNS = Path(__file__).parents[3] / "fixtures" / "runs"


@pytest.mark.parametrize(("name", "seed"), [("ddpg-0.1", 1), ("landing-model-0.1", 0)])
def test_an_earlier_run_goes_on_as_it_would_have(name: str, seed: int, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(RUNS / name, run)
    before, _ = read_lines(seed_files(run, seed).metrics)
    expected, _ = read_lines(run / "continued.jsonl")
    assert run_training(run, progress=lambda share: None, stopped=lambda: False) == "finished"
    lines, _ = read_lines(seed_files(run, seed).metrics)
    assert lines[: len(before)] == before
    assert len(lines) == len(before) + len(expected)
    for ours, theirs in zip(lines[len(before) :], expected, strict=True):
        assert (ours["serve"], ours["goal_m"], ours["case"]) == (theirs["serve"], theirs["goal_m"], theirs["case"])
        assert ours["action"] == pytest.approx(theirs["action"], abs=1e-4)  # sums are in another order
