"""Every comparison of the decision half, over many seeds: trained once, kept, and written up as one report.

An interrupted bench goes on where it was; `write_learning_report` can be called at any time with what is there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from benchmarks.learning.claims import claim_batches, claim_experiments, claims_section
from benchmarks.learning.plan import Counts, Experiment, counts_of, is_minor, plan
from benchmarks.learning.real_balls import real_balls_section, real_experiments, seen_people
from benchmarks.learning.report import replace_section, write_learning_report
from benchmarks.learning.runs import (
    Results,
    SeedResult,
    event_training,
    load_played,
    load_results,
    missing_seeds,
    play_seed,
    train_missing,
    values_at_end,
)
from benchmarks.machine import describe_machine
from core.errors import ConfigError
from core.jobs import ALONE, HERE, JobBackend, open_jobs
from core.learning.runs.summary import finite_or_none, spread_of
from core.learning.task.recorded_balls import ball_state_files

Progress = Callable[[float], None]

FOLDER = Path("rallyscope-data/bench-learning")
REPORT = Path("docs/measured/learning-report.md")
CLOCK = "processor time of one thread"
SECTIONS: Final = ("claims", "real-balls")
"""Parts of the report that can be made alone."""
SEEDS_AT_A_TIME = 5
EVENT_BALL = 200
"""Episodes in closed form that take as long as a ball before event cameras, about."""


def run(
    progress: Progress,
    *,
    folder: Path = FOLDER,
    report: Path = REPORT,
    count: int | None = None,
    counts: Counts | None = None,
    only: str | None = None,
    recorded: str | None = None,
    engine: JobBackend = HERE,
) -> dict[str, object]:
    """A row per training, the report's place, and the machine. Seeds are sent to the engine, evaluations come back.

    `count`: seeds of everything that is compared. `only`: a name of SECTIONS; the rest of the report stays as it is.
    `recorded`: balls of human play, a file of ball states or a folder of them.

    Raises:
        ConfigError: if there is no such section, or there are no recorded balls.
    """
    counts = counts or (Counts() if count is None else counts_of(count))
    if only is not None and only not in SECTIONS:
        raise ConfigError("no such part of the report", expected=" or ".join(SECTIONS), got=only, where="only")
    if recorded is not None:
        ball_state_files(recorded)
        recorded = str(Path(recorded).resolve())
    machine = describe_machine("numpy", "torch", "numba", clock=CLOCK)
    claims = () if only == "real-balls" else claim_experiments(counts)
    real = () if only == "claims" else real_experiments(counts, recorded)
    experiments = (*(() if only else plan(counts)), *real, *claims)
    events, people = event_training(counts), None if only == "claims" else seen_people(counts, recorded)
    played = [training for training in (None if only else events, people) if training is not None]
    total = sum(experiment.config.episodes * experiment.config.seeds for experiment in experiments)
    total += sum(EVENT_BALL * training.balls_played * training.seeds for training in played)
    done = 0

    def write(results: Results) -> None:
        sections = [claims_section(claims, results)] if claims else []
        if real:
            sections.append(real_balls_section(real, results, folder, recorded, people))
        if only:
            replace_section(report, *sections)
            return
        seen = load_played(events, folder)
        write_learning_report(report, experiments, results, counts, machine, seen, sections)

    wanted = [*batches(experiments[: len(experiments) - len(claims)]), *claim_batches(claims)]
    missing = [missing_seeds(batch, folder) for batch in wanted]
    most = max(map(len, missing))
    with open_jobs(engine if most else ALONE, most) as jobs:
        for batch, pieces in zip(wanted, missing, strict=True):
            done += _episodes(batch) - _episodes(pieces)
            base, episodes = done, _episodes(pieces)
            train_missing(
                jobs,
                pieces,
                folder,
                lambda share, base=base, episodes=episodes: progress((base + share * episodes) / total),
            )
            done += episodes
            if pieces:
                # A batch may take a quarter of an hour: what there is can be read meanwhile.
                write(load_results(experiments, folder))
    results = load_results(experiments, folder)
    write(results)
    for training in played:
        for seed in range(training.seeds):
            if play_seed(training, folder, seed):
                write(results)
            done += EVENT_BALL * training.balls_played
            progress(done / total)
    return {
        "rows": [_row(experiment, results[experiment.name]) for experiment in experiments],
        "report": str(report),
        "machine": machine,
    }


def _episodes(pieces: Sequence[tuple[Experiment, int]]) -> int:
    return sum(experiment.config.episodes for experiment, _ in pieces)


def batches(experiments: Sequence[Experiment]) -> list[list[tuple[Experiment, int]]]:
    """All trainings, in batches of a few seeds of everything: whenever it is interrupted, every row has its share.

    What figures are aimed at is completed before the further seeds of variants.
    """
    found: dict[float, list[tuple[Experiment, int]]] = {}
    for experiment in experiments:
        for k in range(experiment.config.seeds):
            batch = math.inf if k >= SEEDS_AT_A_TIME and is_minor(experiment) else k // SEEDS_AT_A_TIME
            found.setdefault(batch, []).append((experiment, experiment.config.first_seed + k))
    return [found[batch] for batch in sorted(found)]


def _row(experiment: Experiment, results: list[SeedResult]) -> dict[str, object]:
    speed = experiment.config.curriculum.speeds_mps[-1]
    error = spread_of(values_at_end(results, speed, "error_mm"))
    return {
        "training": experiment.name,
        "speed_mps": speed,
        "episodes": experiment.config.episodes,
        "seeds": len(results),
        "returned": finite_or_none(spread_of(values_at_end(results, speed, "returned")).mean),
        "error_mm": finite_or_none(error.mean),
        "error_std_mm": finite_or_none(error.std),
        "five_best_mm": finite_or_none(spread_of([result.five_best_mm(speed) for result in results]).mean),
        "cpu_s": finite_or_none(spread_of([result.cpu_s for result in results]).mean),
    }
