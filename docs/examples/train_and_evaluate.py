"""Trains a policy and evaluates it: `python docs/examples/train_and_evaluate.py [RUN] [EPISODES]`."""

import dataclasses
import sys
import tempfile
from pathlib import Path

from core.learning import create_run, default_run, evaluate_run, run_training

run = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp()) / "run"
episodes = int(sys.argv[2]) if len(sys.argv) > 2 else 300

config = default_run("landing-model")
config = dataclasses.replace(
    config, curriculum=dataclasses.replace(config.curriculum, episodes=(episodes,)), evaluation_balls=200
)
create_run(run, config)
print(f"training {run}: {run_training(run)}")
for row in evaluate_run(run):
    print(f"{row['speed_mps']:g} m/s, {row['balls']} balls: {100 * row['returned']:.1f} % returned")
    print(f"median error {row['error_mm']['median']:.0f} mm")
