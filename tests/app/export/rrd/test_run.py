"""A training run as a Rerun file."""

import json
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from app.cli import main
from app.export.rrd.run import export_run, moving_mean
from core.errors import CommandError
from core.learning.config import RunConfig
from core.learning.runs.run_files import create_run, seed_files
from tests.app.export.tasks import run_task
from tests.waiting import PATIENCE_S


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of two seeds, as the training writes it; one ball in ten is missed and has no landing."""
    folder = tmp_path / "run"
    create_run(folder, RunConfig())
    for seed in (0, 3):
        files = seed_files(folder, seed)
        files.folder.mkdir()
        lines = [
            {
                "episode": n, "case": 5 if n % 10 == 0 else 4, "reward": 0.1 * n, "noise": 0.1,
                "error_mm": None if n % 10 == 0 else 100.0, "goal_m": [0.7, 0.1],
                "landing_m": [None, None] if n % 10 == 0 else [0.8, 0.0],
            }
            for n in range(40)
        ]  # fmt: skip
        files.metrics.write_text("".join(json.dumps(line) + "\n" for line in lines))
        files.evaluations.write_text(
            json.dumps({"episode": 30, "speed_mps": 3.0, "balls": 500, "returned": 0.9, "error_mm": 80.0}) + "\n"
        )
    return folder


def test_spots_and_curves_of_every_seed_are_over_the_episodes(run: Path, tmp_path, capsys) -> None:
    out = tmp_path / "run.rrd"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rr.set_strict_mode(True)
        assert main(["export", str(run), "--rrd", str(out), "--json"]) == 0
        rr.set_strict_mode(False)
    assert json.loads(capsys.readouterr().out)["files"] == [{"path": str(out), "bytes": out.stat().st_size}]
    words = {name: _rerun(name, out) for name in ("verify", "stats")}
    assert "verified without error" in words["verify"]
    wanted = {f"/world/seed_{seed}/{name}" for seed in (0, 3) for name in ("landing", "target")}
    wanted |= {f"/plots/{name}/seed_3" for name in ("returned", "error", "reward", "noise")}
    for entity in {*wanted, "/plots/error/seed_0_fixed_3_mps"}:
        assert f"{entity}: " in words["stats"], entity
    assert "index_name: episode" in _rerun("print", "-vv", out)


def test_a_run_has_no_events_to_export_and_must_have_been_played(run: Path, tmp_path, capsys) -> None:
    assert main(["export", str(run), "--dsec", str(tmp_path / "x")]) == 2
    assert "no such export" in capsys.readouterr().err
    for seed in (0, 3):
        seed_files(run, seed).metrics.unlink()
    with pytest.raises(CommandError, match="nothing was played"):
        export_run(run_task(run, tmp_path / "y.rrd"))
    assert not (tmp_path / "y.rrd").exists()


def test_a_moving_mean_is_over_what_is_known() -> None:
    values = np.array([np.nan, 2.0, 4.0, np.nan, 10.0])
    assert np.array_equal(moving_mean(values, 2), [np.nan, 2.0, 3.0, 4.0, 10.0], equal_nan=True)


def _rerun(*words) -> str:
    command = [sys.executable, "-m", "rerun", "rrd", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    return done.stdout + done.stderr
