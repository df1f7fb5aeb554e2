"""Every comparison of the decision half, over many seeds: trained once, kept, and written up as one report.

An interrupted bench goes on where it was; `write_learning_report` can be called at any time with what is there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from core.bench.learning.plan import Counts, Experiment, is_minor, plan
from core.bench.learning.report import write_learning_report
from core.bench.learning.runs import Results, SeedResult, load_results, train_seed, values_at_end
from core.bench.machine import describe_machine
from core.learning.runs.summary import rounded_number, spread_of
from core.text.json_text import parse_json

Progress = Callable[[float], None]

FOLDER = Path("rallyscope-data/bench-learning")
REPORT = Path("docs/measured/learning-report.md")
CHAIN = "events.json"
CLOCK = "processor time of one thread"
SEEDS_AT_A_TIME = 5


def run(
    progress: Progress, *, folder: Path = FOLDER, report: Path = REPORT, counts: Counts | None = None
) -> dict[str, object]:
    """A row per training, the report's place, and the machine."""
    counts = counts or Counts()
    experiments = plan(counts)
    machine = describe_machine("numpy", "torch", "numba", clock=CLOCK)
    total = sum(experiment.config.episodes * experiment.config.seeds for experiment in experiments)
    done = 0

    def write(results: Results) -> None:
        write_learning_report(report, experiments, results, counts, machine, read_chain(folder))

    for batch in batches(experiments):
        trained = 0
        for experiment, seed in batch:
            trained += train_seed(experiment, folder, seed)
            done += experiment.config.episodes
            progress(done / total)
        if trained:
            # A batch may take a quarter of an hour: what there is can be read meanwhile.
            write(load_results(experiments, folder))
    results = load_results(experiments, folder)
    write(results)
    return {
        "rows": [_row(experiment, results[experiment.name]) for experiment in experiments],
        "report": str(report),
        "machine": machine,
    }


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


def read_chain(folder: Path) -> list[dict[str, object]]:
    """What `rallyscope evaluate --json` said of a run with event cameras, if somebody put it there.

    Playing before cameras takes seconds a ball and needs the chain, which is built on top of this package.
    """
    path = folder / CHAIN
    rows = parse_json(path.read_text(encoding="utf-8")) if path.is_file() else []
    return [dict(row) for row in rows]


def _row(experiment: Experiment, results: list[SeedResult]) -> dict[str, object]:
    speed = experiment.config.curriculum.speeds_mps[-1]
    error = spread_of(values_at_end(results, speed, "error_mm"))
    return {
        "training": experiment.name,
        "speed_mps": speed,
        "episodes": experiment.config.episodes,
        "seeds": len(results),
        "returned": rounded_number(spread_of(values_at_end(results, speed, "returned")).mean),
        "error_mm": rounded_number(error.mean),
        "error_std_mm": rounded_number(error.std),
        "five_best_mm": rounded_number(spread_of([result.five_best_mm(speed) for result in results]).mean),
        "cpu_s": rounded_number(spread_of([result.cpu_s for result in results]).mean),
    }
