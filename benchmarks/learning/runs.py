"""Trains what the plan asks for, each seed by itself, and keeps only the evaluations: an interrupted bench goes on."""

from __future__ import annotations

import hashlib
import math
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Final

import numpy as np
import tomli_w

from benchmarks.learning.plan import Experiment
from core.config import config_to_mapping
from core.files import read_json, write_json
from core.jobs import Jobs, TaskControl, TasksStoppedError
from core.learning.config import RunConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator, five_best_mm
from core.learning.runs.run_files import create_run, load_policy, read_lines, seed_files
from core.learning.runs.running import run_training
from core.learning.task.recorded_balls import ball_state_files


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The policy of a seed after so many episodes, on the fixed balls."""

    episode: int
    speed_mps: float
    returned: float
    error_mm: float
    """Over all balls, a missed one as the table's length."""
    error_returned_mm: float
    missed: float
    """Share of balls that the racket did not meet."""


@dataclass(frozen=True, slots=True)
class SeedResult:
    """What one trained seed achieved."""

    seed: int
    evaluations: tuple[Evaluation, ...]
    transfers: dict[str, Evaluation]
    cpu_s: float
    """Processor time of training and its evaluations."""
    median_mm: float = math.nan
    """Error of the last policy at the last speed, over all balls."""

    def at(self, episode: int) -> Evaluation | None:
        """After exactly so many episodes."""
        return next((e for e in self.evaluations if e.episode == episode), None)

    def last(self, speed_mps: float) -> Evaluation | None:
        """At the end of the stage of a speed."""
        return next((e for e in reversed(self.evaluations) if e.speed_mps == speed_mps), None)

    def five_best_mm(self, speed_mps: float) -> float:
        """Mean of the five lowest errors at a speed."""
        return five_best_mm([e.error_mm for e in self.evaluations if e.speed_mps == speed_mps])


COUNTED: Final = "missed balls count 2740 mm"
"""Results that were counted otherwise are others."""
LATER: Final = {"state": "plain", "recorded": "", "spin_noise_radps": 10.0, "racket": "table"}
"""Settings of the environment that came later: with these values results are, and are called, what they were before."""
Results = defaultdict[str, list[SeedResult]]
"""The seeds of every training, by its name; none of one that was not trained."""


def missing_seeds(wanted: Sequence[tuple[Experiment, int]], folder: Path) -> list[tuple[Experiment, int]]:
    """Those that are not in the folder already."""
    return [(experiment, seed) for experiment, seed in wanted if not _path(experiment, folder, seed).exists()]


def train_seed(wanted: tuple[Experiment, int], control: TaskControl) -> dict[str, object]:
    """Train one seed, in a folder that is gone afterwards; gives what `keep_seed` keeps.

    Raises:
        TasksStoppedError: if nobody wants it any more.
    """
    experiment, seed = wanted
    with tempfile.TemporaryDirectory(prefix="rallyscope-") as folder:
        return _train_seed(experiment, seed, Path(folder) / "run", control)


def keep_seed(wanted: tuple[Experiment, int], answer: dict[str, object], folder: Path) -> None:
    """Keep what came of a seed."""
    experiment, seed = wanted
    write_json(_path(experiment, folder, seed), answer)


def train_missing(
    jobs: Jobs, pieces: Sequence[tuple[Experiment, int]], folder: Path, progress: Callable[[float], None]
) -> None:
    """Train seeds that are not in the folder, and keep each as soon as it is done."""
    jobs.run(
        train_seed,
        pieces,
        name=lambda piece: f"{piece[0].name} seed {piece[1]}",
        done=lambda number, answer: keep_seed(pieces[number], answer, folder),
        progress=progress,
    )


def load_results(experiments: Sequence[Experiment], folder: Path) -> Results:
    """What there is of every experiment."""
    results: Results = defaultdict(list)
    for experiment in experiments:
        first = experiment.config.first_seed
        for seed in range(first, first + experiment.config.seeds):
            if answer := read_json(_path(experiment, folder, seed)):
                results[experiment.name].append(_result(seed, answer))
    return results


def _train_seed(experiment: Experiment, seed: int, run: Path, control: TaskControl) -> dict[str, object]:
    config = replace(experiment.config, seeds=1, first_seed=seed)
    create_run(run, config)
    started = time.process_time()
    if run_training(run, progress=control, stopped=control.stopped) == "stopped":
        raise TasksStoppedError
    cpu_s = time.process_time() - started
    lines, _ = read_lines(seed_files(run, seed).evaluations)
    policy = load_policy(run, seed)
    transfers: dict[str, object] = {}
    for name, environment in experiment.transfers:
        speed = config.curriculum.speeds_mps[-1]
        score = PolicyEvaluator(environment, config.evaluation_balls).score(policy, speed)
        found = Evaluation(
            config.episodes, speed, score.return_rate, score.error_mm, score.error_returned_mm, score.missed
        )
        transfers[name] = asdict(found)
    speed = config.curriculum.speeds_mps[-1]
    last = PolicyEvaluator(config.environment, config.evaluation_balls).score(policy, speed)
    median_mm = float(np.median(last.counted_mm))
    return {"evaluations": lines, "transfers": transfers, "cpu_s": cpu_s, "median_mm": median_mm}


def _path(experiment: Experiment, folder: Path, seed: int) -> Path:
    """Named by what is trained: a changed setting is another result."""
    return folder / f"{experiment.name}-{fingerprint(experiment.config)}" / f"seed-{seed}.json"


def fingerprint(config: RunConfig) -> str:
    """A hash of everything but the seeds, and of how results are counted; of recorded balls what is in the files."""
    mapping = config_to_mapping(replace(config, seeds=1, first_seed=0))
    environment = mapping["environment"]
    assert isinstance(environment, dict)
    if config.environment.recorded:
        data = b"".join(path.read_bytes() for path in ball_state_files(config.environment.recorded))
        environment["recorded"] = hashlib.sha256(data).hexdigest()
    for name, default in LATER.items():
        if environment[name] == default:
            del environment[name]
    text = COUNTED + tomli_w.dumps(mapping)
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def _result(seed: int, answer: dict[str, object]) -> SeedResult:
    lines, transfers, cpu_s = answer["evaluations"], answer["transfers"], answer["cpu_s"]
    assert isinstance(lines, list) and isinstance(transfers, dict) and isinstance(cpu_s, float)
    named = {name: _evaluation(line) for name, line in transfers.items()}
    median_mm = answer.get("median_mm", math.nan)
    assert isinstance(median_mm, float)
    return SeedResult(seed, tuple(_evaluation(line) for line in lines), named, cpu_s, median_mm)


def _evaluation(line: dict[str, float | None]) -> Evaluation:
    values = {field.name: line[field.name] for field in fields(Evaluation)}
    return Evaluation(**{name: math.nan if value is None else value for name, value in values.items()})  # type: ignore[arg-type]


def values_at(results: Sequence[SeedResult], episode: int, what: str) -> list[float]:
    """One number per seed after so many episodes; what: a field of `Evaluation`."""
    return [getattr(evaluation, what) for result in results if (evaluation := result.at(episode)) is not None]


def values_at_end(results: Sequence[SeedResult], speed_mps: float, what: str) -> list[float]:
    """One number per seed at the end of the stage of a speed."""
    return [getattr(evaluation, what) for result in results if (evaluation := result.last(speed_mps)) is not None]
