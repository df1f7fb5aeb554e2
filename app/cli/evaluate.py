"""`rallyscope evaluate`: a trained run on fixed balls, with the trivial policies beside it; or recorded ball states."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from app.cli import ball_states
from app.cli.arguments import positive_int
from app.cli.bench import format_table
from app.cli.episode_backends import open_backend
from app.cli.progress import progress_bar
from core.errors import CommandError
from core.learning.runs.run_files import read_run
from core.learning.runs.summary import evaluate_run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("run_folder", nargs="?", type=Path, metavar="RUN", help="folder of a training run")
    parser.add_argument("--best", action="store_true", help="the best policy of each seed instead of the last")
    parser.add_argument(
        "--balls", type=positive_int, metavar="N", help="fixed balls per speed (default: the run's, 500)"
    )
    parser.add_argument("--json", action="store_true", help="print a row per speed as JSON")
    ball_states.add_arguments(parser)


def run(arguments: argparse.Namespace) -> None:
    """Evaluate and print."""
    if (arguments.run_folder is None) == (arguments.ball_states is None):
        raise CommandError("what is to be evaluated?", expected="a RUN, or --ball-states FILE, one of them")
    if arguments.ball_states is not None:
        ball_states.run_ball_states(arguments)
        return
    which = "best" if arguments.best else "last"
    with open_backend(read_run(arguments.run_folder), None) as backend:
        if backend is None:
            rows = evaluate_run(arguments.run_folder, balls=arguments.balls, which=which)
        else:
            with progress_bar("Playing before the cameras") as progress:
                rows = evaluate_run(
                    arguments.run_folder, balls=arguments.balls, which=which, backend=backend, progress=progress
                )
    if arguments.json:
        print(json.dumps(rows))
        return
    print(format_table([line for row in rows for line in _lines(row)]))


def _lines(row: dict[str, object]) -> list[dict[str, object]]:
    """The run and what stands beside it, a line each."""
    speed = row["speed_mps"]
    error, baselines = row["error_mm"], row["baselines"]
    assert isinstance(error, dict) and isinstance(baselines, dict)
    lines: list[dict[str, object]] = [
        {"m/s": speed, "policy": f"this run ({row['seeds']} seeds)", "returned": row["returned"], **_millimetres(error)}
    ]
    for name, score in baselines.items():
        lines.append(
            {
                "m/s": speed,
                "policy": name.replace("_", " "),
                "returned": score.get("returned"),
                **_millimetres({"mean": score["error_mm"]}),
            }
        )
    return lines


def _millimetres(error: dict[str, float | None]) -> dict[str, object]:
    return {f"{name} mm": error.get(name) for name in ("mean", "median", "p95")}
