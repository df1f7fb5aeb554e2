"""`rallyscope evaluate`: a trained run on fixed balls, with the trivial policies beside it; or recorded ball states."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from app.cli.arguments import PositiveInt, flag, given, positional, setting_flag
from app.cli.episode_backends import open_backend
from app.cli.progress import progress_bar
from app.cli.randomise_argument import RANDOMISE_HELP, RANDOMISE_METAVAR, RandomisedNames, randomised
from app.cli.terminal import format_table, say
from core.chain.config import HIT_RULES, HitRule
from core.errors import CommandError
from core.extras import require_package
from core.learning.config import EnvironmentConfig, SimulatorName
from core.learning.evaluation.reachable import reachable_words
from core.learning.runs.run_files import read_run
from core.learning.runs.summary import evaluate_run
from core.live.worlds.simulated_returns import (
    PlayedFile,
    SimulatedReturnsConfig,
    losses,
    play_recorded_states,
    report_rows,
    write_ball_states_report,
)
from core.physics.ball_states import read_ball_states
from core.physics.config import Profile
from core.physics.task import task_profile


@dataclass(frozen=True, slots=True, kw_only=True)
class BallStatesArguments:
    """What concerns ball states."""

    TITLE: ClassVar = "balls of human play, against the built-in controller that knows all of them"
    ball_states: tuple[Path, ...] | None = flag("JSON of position, velocity and spin (no RUN then)", "FILE")
    sample: PositiveInt | None = flag("random sample of N balls per file instead of all", "N")
    told_after_ms: float = setting_flag(SimulatedReturnsConfig, "told_after_ms", "MS")
    hit: HitRule | None = flag(
        "where balls are met", "|".join(HIT_RULES), "paper; of a RUN, as it was trained", choices=HIT_RULES
    )
    physics: Profile = flag("how balls fly and bounce", default="real")
    report: Path | None = flag("write a page with a picture (matplotlib draws it)", "FILE.md")


def run_ball_states(arguments: BallStatesArguments, paths: tuple[Path, ...], *, as_json: bool) -> None:
    """Play all of them, and print or write what came of it."""
    report = arguments.report
    if report is not None and (report.suffix != ".md" or not report.parent.is_dir()):
        raise CommandError("no such page", expected="FILE.md in a folder that exists", got=report, where="--report")
    config = SimulatedReturnsConfig(
        task=task_profile(arguments.physics), hit=arguments.hit or "paper", told_after_ms=arguments.told_after_ms
    )
    read = [read_ball_states(path) for path in paths]
    if arguments.sample is not None:
        # Fixed: a sample of one size is the same balls every time.
        rng = np.random.default_rng(0)
        read = [balls[np.sort(rng.permutation(len(balls))[: arguments.sample])] for balls in read]
    files: list[PlayedFile] = []
    with progress_bar("Playing balls of human play") as progress:
        done, total = 0, sum(map(len, read))
        for path, balls in zip(paths, read, strict=True):
            share = len(balls) / total
            played = play_recorded_states(
                balls, config, lambda of, done=done, share=share: progress(done / total + share * of)
            )
            files.append(PlayedFile(path.stem, balls, played))
            done += len(balls)
    rows = report_rows(files)
    if report is not None:
        write_ball_states_report(report, files, config, _command(arguments, paths))
    if as_json:
        say(json.dumps(rows | {"losses": {file.name: losses(file.played) for file in files}}))
        return
    for table in rows.values():
        say(format_table(table))
        say()
    lost = [losses(file.played).items() for file in files]
    say(format_table([{"lost to": words, "balls": count} for counts in lost for words, count in counts]))


def _command(arguments: BallStatesArguments, paths: tuple[Path, ...]) -> str:
    """What was asked for, with the files' plain names."""
    words = ["rallyscope evaluate --ball-states", *(path.name for path in paths), f"--physics {arguments.physics}"]
    if arguments.hit == "chosen":
        words.append(f"--hit {arguments.hit}")
    if arguments.told_after_ms:
        words.append(f"--told-after-ms {arguments.told_after_ms:g}")
    if arguments.sample is not None:
        words.append(f"--sample {arguments.sample}")
    return " ".join(words)


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluateArguments:
    """Evaluate a trained policy on fixed balls, or the built-in controller on recorded ones."""

    run_folder: Path | None = positional("folder of a training run", "RUN")
    best: bool = flag("the best policy of each seed instead of the last")
    balls: PositiveInt | None = flag("fixed balls per speed", "N", "the run's, 500")
    json: bool = flag("print a row per speed as JSON")
    simulator: SimulatorName | None = flag(
        "what plays serves and strokes: closed form, or MuJoCo as in the live rally", default="the run's"
    )
    randomise: RandomisedNames | None = flag(RANDOMISE_HELP, RANDOMISE_METAVAR, "the run's")
    racket: Literal["table", "uncertain"] | None = flag(
        "a racket that does as it is told, or one whose angles and speed are off", default="the run's"
    )
    recorded: BallStatesArguments


def run(arguments: EvaluateArguments) -> None:
    """Evaluate and print."""
    folder, ball_states = arguments.run_folder, arguments.recorded.ball_states
    if folder is not None and ball_states is None:
        _evaluate(folder, arguments)
    elif folder is None and ball_states is not None:
        run_ball_states(arguments.recorded, ball_states, as_json=arguments.json)
    else:
        raise CommandError("nothing to evaluate", expected="a RUN, or --ball-states FILE, one of them")


ELSEWHERE = ("simulator", "randomise", "racket")
"""Flags that evaluate a policy in another world than it was trained in."""


def _asked_environment(environment: EnvironmentConfig, arguments: EvaluateArguments) -> EnvironmentConfig:
    """The run's environment with what the flags change.

    Raises:
        CommandError: if the policy chooses the racket's speed and the flags give it another rule.
    """
    if arguments.racket is not None and environment.racket == "chosen":
        raise CommandError("the policy chooses the racket's speed", got="--racket", remedy="leave it out")
    return dataclasses.replace(
        environment,
        randomise=randomised(environment.randomise, arguments.randomise),
        **given({"engine": arguments.simulator, "racket": arguments.racket, "hit": arguments.recorded.hit}),
    )


def _evaluate(folder: Path, arguments: EvaluateArguments) -> None:
    which, config = "best" if arguments.best else "last", read_run(folder)
    environment = _asked_environment(config.environment, arguments)
    config = dataclasses.replace(config, environment=dataclasses.replace(config.environment, hit=environment.hit))
    if environment.engine == "mujoco":
        require_package("mujoco", "--simulator mujoco")
    with open_backend(config, None) as backend:
        if backend is None:
            rows = evaluate_run(folder, balls=arguments.balls, which=which, environment=environment)
        elif elsewhere := given({name: getattr(arguments, name) for name in ELSEWHERE}):
            names = ", ".join(f"--{name}" for name in elsewhere)
            raise CommandError("balls before cameras are played where they are seen", got=names, remedy="leave it out")
        else:
            with progress_bar("Playing before the cameras") as progress:
                rows = evaluate_run(
                    folder,
                    balls=arguments.balls,
                    which=which,
                    environment=environment,
                    backend=backend,
                    progress=progress,
                )
    if arguments.json:
        say(json.dumps(rows))
        return
    say(format_table([line for row in rows for line in _lines(row)]))
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
