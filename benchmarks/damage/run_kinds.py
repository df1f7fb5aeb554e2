"""Damage trials of the folder of a training run: config, status, control, lines, checkpoint and policy."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.damage.kinds import DamageKind
from benchmarks.damage.text_kinds import damage_text
from core.learning.agents.policy import Policy, save_policy
from core.learning.config import RunConfig
from core.learning.runs.checkpoints import load_checkpoint, save_checkpoint
from core.learning.runs.control import Control, RunStatus, read_control, read_status, write_control, write_status
from core.learning.runs.run_files import create_run, load_policy, read_lines, read_run, seed_files, seeds_of


def _make_run(folder: Path) -> None:
    run = folder / "run"
    create_run(run, RunConfig())
    write_status(run, RunStatus("stopped", 1, 1, 2, 3, 0.5, 6.0, None))
    write_control(run, Control())
    files = seed_files(run, 1)
    rng = np.random.default_rng(2)
    arrays = {"agent.w": rng.normal(0, 1, (8, 8)), "recent": np.zeros(10, np.bool_)}
    save_checkpoint(files.checkpoint, arrays, {"seed": 1, "episode": 2, "metrics_bytes": 20})
    sizes = (8, 16, 3)
    layers = tuple((rng.normal(0, 0.1, (a, b)).astype(np.float32), np.zeros(b, np.float32)) for a, b in pairwise(sizes))
    for path in (files.policy, files.best):
        save_policy(
            Policy(layers, "relu", "tanh", False, np.array([4, 6], np.float32), np.array([1, 2], np.float32)), path
        )
    line = {"case": 3, "reward": 0.5, "error_mm": 30.5, "landing_m": [0.5, 0.1], "goal_m": [0.6, 0.0]}
    for path in (files.metrics, files.evaluations):
        path.write_text("".join(json.dumps({"episode": number, **line}) + "\n" for number in range(5)))


def _open_run(folder: Path) -> tuple[str, ...]:
    run = folder / "run"
    config = read_run(run)
    read_status(run)
    read_control(run)
    assert config.episodes > 0
    for seed in seeds_of(run):
        files = seed_files(run, seed)
        for path in (files.metrics, files.evaluations):
            read_lines(path)
        load_checkpoint(files.checkpoint)
        for which in ("last", "best"):
            policy = load_policy(run, seed, which)
            assert policy.act([-1.3, 0, 0.3, 4, 0, 1], [0.7, 0]).shape == (3,)
    return ()


RUNS: Final = DamageKind(name="training run", make=_make_run, damage=damage_text, open=_open_run)
