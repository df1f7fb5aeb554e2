"""`rallyscope evaluate --ball-states`: recorded balls of human play against the simulated robot."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from app.cli.arguments import PositiveInt, flag, setting_flag
from app.cli.progress import progress_bar
from app.cli.tables import format_table
from app.cli.terminal import say
from core.errors import CommandError
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
    sample: PositiveInt | None = flag("so many of each file at random, not all", "N")
    told_after_ms: float = setting_flag(SimulatedReturnsConfig, "told_after_ms", "MS")
    physics: Profile = flag("how balls fly and bounce", default="real")
    report: Path | None = flag("write a page with a picture (matplotlib draws it)", "FILE.md")


def run_ball_states(arguments: BallStatesArguments, paths: tuple[Path, ...], *, as_json: bool) -> None:
    """Play all of them, and print or write what came of it."""
    report = arguments.report
    if report is not None and (report.suffix != ".md" or not report.parent.is_dir()):
        raise CommandError("no such page", expected="FILE.md in a folder that exists", got=report, where="--report")
    config = SimulatedReturnsConfig(task=task_profile(arguments.physics), told_after_ms=arguments.told_after_ms)
    read = [read_ball_states(path) for path in paths]
    if arguments.sample is not None:
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
    if arguments.told_after_ms:
        words.append(f"--told-after-ms {arguments.told_after_ms:g}")
    if arguments.sample is not None:
        words.append(f"--sample {arguments.sample}")
    return " ".join(words)
