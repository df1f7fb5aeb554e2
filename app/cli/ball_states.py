"""`rallyscope evaluate --ball-states`: recorded balls of human play against the simulated robot."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from app.cli.arguments import positive_int
from app.cli.bench import format_table
from app.cli.progress import progress_bar
from core.bench.rally.ball_states_report import PlayedFile, losses, report_rows, write_ball_states_report
from core.errors import CommandError
from core.physics.ball_states import read_ball_states
from core.physics.task import task_profile
from core.rally.simulated.simulated_returns import SimulatedReturnsConfig, play_known_balls


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What concerns ball states."""
    group = parser.add_argument_group("balls of human play, against the built-in controller that knows all of them")
    group.add_argument(
        "--ball-states", nargs="+", type=Path, metavar="FILE", help="JSON of position, velocity and spin (no RUN then)"
    )
    group.add_argument("--sample", type=positive_int, metavar="N", help="so many of each file at random, not all")
    group.add_argument(
        "--told-after-ms", type=float, default=0.0, metavar="MS", help="how late it is told (default: 0)"
    )
    group.add_argument("--physics", default="real", choices=("paper", "real"), help="default: %(default)s")
    group.add_argument(
        "--report", type=Path, metavar="FILE.md", help="write a page with a picture (matplotlib draws it)"
    )


def run_ball_states(arguments: argparse.Namespace) -> None:
    """Play all of them, and print or write what came of it."""
    report: Path | None = arguments.report
    if report is not None and (report.suffix != ".md" or not report.parent.is_dir()):
        raise CommandError("no such page", expected="FILE.md in a folder that exists", got=report, where="--report")
    config = SimulatedReturnsConfig(task=task_profile(arguments.physics), told_after_ms=arguments.told_after_ms)
    paths: list[Path] = arguments.ball_states
    read = [read_ball_states(path) for path in paths]
    if arguments.sample is not None:
        rng = np.random.default_rng(0)
        read = [balls[np.sort(rng.permutation(len(balls))[: arguments.sample])] for balls in read]
    files: list[PlayedFile] = []
    with progress_bar("Playing balls of human play") as progress:
        done, total = 0, sum(map(len, read))
        for path, balls in zip(paths, read, strict=True):
            share = len(balls) / total
            played = play_known_balls(
                balls, config, lambda of, done=done, share=share: progress(done / total + share * of)
            )
            files.append(PlayedFile(path.stem, balls, played))
            done += len(balls)
    rows = report_rows(files)
    if report is not None:
        write_ball_states_report(report, files, config, _command(arguments, paths))
    if arguments.json:
        print(json.dumps(rows | {"losses": {file.name: losses(file.played) for file in files}}))
        return
    for table in rows.values():
        print(format_table(table))
        print()
    print(
        format_table(
            [{"lost to": words, "balls": count} for file in files for words, count in losses(file.played).items()]
        )
    )


def _command(arguments: argparse.Namespace, paths: list[Path]) -> str:
    """What was asked for, with the files' plain names."""
    words = ["rallyscope evaluate --ball-states", *(path.name for path in paths), f"--physics {arguments.physics}"]
    if arguments.told_after_ms:
        words.append(f"--told-after-ms {arguments.told_after_ms:g}")
    if arguments.sample is not None:
        words.append(f"--sample {arguments.sample}")
    return " ".join(words)
