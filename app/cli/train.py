"""`rallyscope train`: train an agent, or go on with a run that was stopped or killed."""

from __future__ import annotations

import argparse
import dataclasses
import json
import signal
import threading
from pathlib import Path
from typing import get_args

from app.cli.arguments import positive_int
from app.cli.episode_backends import open_backend
from app.cli.progress import progress_bar
from core.config import load_config
from core.errors import CommandError
from core.learning.config import (
    AgentName,
    CurriculumConfig,
    ReplayRule,
    RewardKind,
    RunConfig,
    StateSource,
    default_run,
    environment_profile,
)
from core.learning.runs.run_files import create_run, read_run, seed_files

OPTIONS = ("config", "agent", "speeds", "episodes", "advance", "reward", "replay", "seeds", "first_seed")
OPTIONS += ("state_source", "physics", "serves")
"""What describes a new run, and so cannot stand beside --resume."""
BALLS_BEFORE_CAMERAS = 100
"""Fixed balls of an evaluation with states from events: each takes a second to be seen, once per training."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("--out", type=Path, required=True, metavar="RUN", help="folder of the run")
    parser.add_argument("--resume", action="store_true", help="go on with the run in that folder")
    parser.add_argument("--config", type=Path, metavar="FILE", help="a config.toml; other options change it")
    parser.add_argument("--agent", choices=get_args(AgentName), help="default: ddpg, the paper's")
    parser.add_argument("--speeds", type=_numbers, metavar="3,5", help="curriculum: serve speeds in m/s, 3 to 9")
    parser.add_argument("--episodes", type=_counts, metavar="800,900", help="of each stage, or one number for all")
    parser.add_argument("--advance", choices=("episodes", "converged"), help="when a stage ends (default: episodes)")
    parser.add_argument("--reward", choices=get_args(RewardKind), help="default: cdta")
    parser.add_argument("--replay", choices=get_args(ReplayRule), help="what a new stage keeps (default: threshold)")
    parser.add_argument("--seeds", type=positive_int, metavar="N", help="independent repetitions (default: 1)")
    parser.add_argument("--first-seed", type=int, metavar="N", help="number of the first one (default: 0)")
    parser.add_argument("--state-source", choices=get_args(StateSource), help="how arriving balls are perceived")
    parser.add_argument("--physics", choices=("paper", "real"), help="default: paper")
    parser.add_argument("--serves", choices=("standard", "hard"), help="default: standard")
    parser.add_argument(
        "--source", metavar="tcp://HOST:PORT", help="play every ball in a simulation server (its outcomes are the same)"
    )
    parser.add_argument("--json", action="store_true", help="print a summary as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Train until the end, or until interrupted: then the run can be resumed."""
    folder: Path = arguments.out
    if arguments.resume:
        given = [name for name in OPTIONS if getattr(arguments, name) is not None]
        if given:
            names = ", ".join("--" + name.replace("_", "-") for name in given)
            raise CommandError("a resumed run keeps its settings", got=names, remedy="leave them out")
        config = read_run(folder)
    else:
        config = requested_run(arguments)
    with open_backend(config, arguments.source) as backend:
        if not arguments.resume:
            create_run(folder, config)
        from core.learning.runs.running import run_training  # late: torch takes a second, a mistake should not

        ended = threading.Event()
        for name in (signal.SIGINT, signal.SIGTERM):
            signal.signal(name, lambda *_: ended.set())
        with progress_bar(f"Training {config.agent}") as progress:
            state = run_training(folder, progress=progress, stopped=ended.is_set, backend=backend)
    _report(folder, config, state, as_json=arguments.json)


def requested_run(arguments: argparse.Namespace) -> RunConfig:
    """The run that the options describe."""
    config = load_config(RunConfig, arguments.config) if arguments.config else default_run(arguments.agent or "ddpg")
    if arguments.config and arguments.agent:
        config = dataclasses.replace(config, agent=arguments.agent)
    if arguments.physics or arguments.serves:
        source = config.environment.state_source
        environment = environment_profile(
            arguments.physics or "paper", serves=arguments.serves or "standard", state_source=source
        )
        config = dataclasses.replace(config, environment=environment)
    if arguments.state_source:
        environment = dataclasses.replace(config.environment, state_source=arguments.state_source)
        config = dataclasses.replace(config, environment=environment)
    if config.environment.state_source == "events" and not arguments.config:
        config = dataclasses.replace(config, evaluation_balls=BALLS_BEFORE_CAMERAS)
    if arguments.reward:
        config = dataclasses.replace(config, reward=dataclasses.replace(config.reward, kind=arguments.reward))
    counts = {"seeds": arguments.seeds, "first_seed": arguments.first_seed}
    config = dataclasses.replace(config, **{name: value for name, value in counts.items() if value is not None})
    return dataclasses.replace(config, curriculum=_curriculum(config, arguments))


def _curriculum(config: RunConfig, arguments: argparse.Namespace) -> CurriculumConfig:
    curriculum = config.curriculum
    speeds: tuple[float, ...] = arguments.speeds or curriculum.speeds_mps
    episodes: tuple[int, ...] = arguments.episodes or curriculum.episodes
    if len(episodes) == 1:
        episodes *= len(speeds)
    elif arguments.episodes is None and len(speeds) != len(episodes):
        # Another number of stages: the first stage as long as usual, all others as the usual last one.
        episodes = (episodes[0],) + (episodes[-1],) * (len(speeds) - 1)
    return dataclasses.replace(
        curriculum,
        speeds_mps=speeds,
        episodes=episodes,
        advance=arguments.advance or curriculum.advance,
        replay=arguments.replay or curriculum.replay,
    )


def _report(folder: Path, config: RunConfig, state: str, *, as_json: bool) -> None:
    from core.learning.runs.run_files import read_lines

    last = []
    for seed in range(config.first_seed, config.first_seed + config.seeds):
        lines, _ = read_lines(seed_files(folder, seed).evaluations)
        last += [{"seed": seed, **lines[-1]}] if lines else []
    if as_json:
        print(json.dumps({"run": str(folder), "state": state, "seeds": last}))
        return
    print(f"{state}: {folder}" + ("" if state == "finished" else "   (go on with --resume)"))
    for line in last:
        error = line["error_mm"]
        shown = "-" if error is None else f"{error:.0f} mm from the target"
        print(f"seed {line['seed']}: {100 * line['returned']:.1f} % returned at {line['speed_mps']:g} m/s, {shown}")


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected numbers with commas between, got {text!r}") from None


def _counts(text: str) -> tuple[int, ...]:
    if not all(part.strip().isdecimal() and int(part) > 0 for part in text.split(",")):
        raise argparse.ArgumentTypeError(f"expected whole numbers above 0 with commas between, got {text!r}")
    return tuple(int(part) for part in text.split(","))
