"""`rallyscope evaluate`: a trained run on fixed balls, with the trivial policies beside it; or recorded ball states."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from app.cli.arguments import PositiveInt, flag, positional
from app.cli.ball_states import BallStatesArguments, run_ball_states
from app.cli.episode_backends import open_backend
from app.cli.progress import progress_bar
from app.cli.tables import format_table
from app.cli.terminal import say
from core.errors import CommandError
from core.learning.evaluation.reachable import reachable_words
from core.learning.runs.run_files import read_run
from core.learning.runs.summary import evaluate_run


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluateArguments:
    """Evaluate a trained policy on fixed balls, or the built-in controller on recorded ones."""

    run_folder: Path | None = positional("folder of a training run", "RUN")
    best: bool = flag("the best policy of each seed instead of the last")
    balls: PositiveInt | None = flag("fixed balls per speed", "N", "the run's, 500")
    json: bool = flag("print a row per speed as JSON")
    recorded: BallStatesArguments


def run(arguments: EvaluateArguments) -> None:
    """Evaluate and print."""
    folder, ball_states = arguments.run_folder, arguments.recorded.ball_states
    if folder is not None and ball_states is None:
        _evaluate(folder, arguments)
    elif folder is None and ball_states is not None:
        run_ball_states(arguments.recorded, ball_states, as_json=arguments.json)
    else:
        raise CommandError("what is to be evaluated?", expected="a RUN, or --ball-states FILE, one of them")


def _evaluate(folder: Path, arguments: EvaluateArguments) -> None:
    which = "best" if arguments.best else "last"
    with open_backend(read_run(folder), None) as backend:
        if backend is None:
            rows = evaluate_run(folder, balls=arguments.balls, which=which)
        else:
            with progress_bar("Playing before the cameras") as progress:
                rows = evaluate_run(folder, balls=arguments.balls, which=which, backend=backend, progress=progress)
    if arguments.json:
        say(json.dumps(rows))
        return
    say(format_table([line for row in rows for line in _lines(row)]))
    config = read_run(folder)
    for words in reachable_words(config.environment, config.curriculum.speeds_mps):
        say(words)


def _lines(row: dict[str, object]) -> list[dict[str, object]]:
    """The run and what stands beside it, a line each."""
    speed = "recorded" if row["recorded"] else row["speed_mps"]
    error, baselines = row["error_mm"], row["baselines"]
    assert isinstance(error, dict) and isinstance(baselines, dict)
    lines: list[dict[str, object]] = [
        {
            "m/s": speed,
            "policy": f"this run ({row['seeds']} seeds)",
            "returned": row["returned"],
            "missed": row["missed"],
            **_millimetres(error),
        }
    ]
    for name, score in baselines.items():
        lines.append(
            {
                "m/s": speed,
                "policy": name.replace("_", " "),
                "returned": score.get("returned"),
                "missed": None,
                **_millimetres({"mean": score["error_mm"]}),
            }
        )
    return lines


def _millimetres(error: dict[str, float | None]) -> dict[str, object]:
    return {f"{name} mm": error.get(name) for name in ("mean", "median", "p95")}
