"""What would the paper's numbers take? Every setting is tried with one seed, the nearest are judged with others.

The screen trains the paper's agent (CDTA, threshold) in every setting; those whose figures lie most often within the
paper's bounds, then nearest, are trained with all rewards and replay rules on seeds of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from benchmarks.learning.paper_settings.report import write_paper_settings
from benchmarks.learning.paper_settings.settings import (
    FIGURES,
    SCREEN_SEED,
    Nearness,
    Setting,
    every_setting,
    nearness,
)
from benchmarks.learning.plan import Experiment
from benchmarks.learning.runs import Results, load_results, missing_seeds, train_missing
from benchmarks.machine import describe_machine
from core.jobs import ALONE, HERE, JobBackend, open_jobs

Progress = Callable[[float], None]

FOLDER: Final = Path("rallyscope-data/bench-paper-settings")
REPORT: Final = Path("docs/measured/paper-settings.md")
JUDGED: Final = 6
"""Settings that go on to be judged."""
SEEDS: Final = 10
"""Of each of their trainings."""


def run(
    progress: Progress,
    *,
    folder: Path = FOLDER,
    report: Path = REPORT,
    count: int = SEEDS,
    settings: Sequence[Setting] | None = None,
    judged: int = JUDGED,
    engine: JobBackend = HERE,
) -> dict[str, object]:
    """A row per setting, the report's place, and the machine. An interrupted bench goes on where it was.

    `count`: seeds of what is judged.
    """
    settings = settings or every_setting()
    screen = [one for s in settings for one in s.trainings(1, SCREEN_SEED, whole=False)]
    work = sum(one.config.episodes for one in screen)
    whole = sum(one.config.episodes * count for one in settings[0].trainings(count, 0, whole=True))
    later = min(judged, len(settings)) * whole
    screened = _train(screen, folder, engine, lambda share: progress(share * work / (work + later)))
    ranked = rank(settings, screened)
    best = [setting for setting, _ in ranked[:judged]]
    wanted = [one for s in best for one in s.trainings(count, 0, whole=True)]
    results = _train(wanted, folder, engine, lambda share: progress((work + share * later) / (work + later)))
    machine = describe_machine("numpy", "torch", clock="none: only what is learned counts")
    write_paper_settings(report, ranked, best, results, count)
    rows = [_row(setting, near) for setting, near in ranked]
    return {"rows": rows, "report": str(report), "machine": machine}


def rank(settings: Sequence[Setting], results: Results) -> list[tuple[Setting, Nearness]]:
    """The settings with most figures within the paper's bounds first, then the nearest."""
    found = [(setting, near) for setting in settings if (near := nearness(setting, results)) is not None]
    return sorted(found, key=lambda pair: (-pair[1].inside, pair[1].distance))


def _train(experiments: Sequence[Experiment], folder: Path, engine: JobBackend, progress: Progress) -> Results:
    seeds = [(e, e.config.first_seed + k) for k in range(max(e.config.seeds for e in experiments)) for e in experiments]
    pieces = missing_seeds(seeds, folder)
    with open_jobs(engine if pieces else ALONE, len(pieces)) as jobs:
        train_missing(jobs, pieces, folder, lambda share: progress(1 - (1 - share) * len(pieces) / len(seeds)))
    progress(1.0)
    return load_results(experiments, folder)


def _row(setting: Setting, near: Nearness) -> dict[str, object]:
    figures = {figure.title: value for figure, value in zip(FIGURES, near.values, strict=True)}
    return {"setting": setting.name, "inside": near.inside, "distance": near.distance, **figures}
