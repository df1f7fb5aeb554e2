"""What makes the paper's agent unsteady: one suspect changed at a time, and agents without its rules, on equal seeds.

    python -m benchmarks.learning.ablation [--seeds 5] [--only ROW ...] [--folder DIR] [--report FILE]

Every seed is kept as soon as it is trained: an interrupted bench goes on, and the table says how many there are of each
row. Seeds from 31000 on, which nothing was chosen on before.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from benchmarks.learning.plan import Experiment, paper, stages
from benchmarks.learning.runs import (
    Results,
    SeedResult,
    load_results,
    missing_seeds,
    pair_by_seed,
    paired_difference,
    seeds_in_turn,
    shown,
    train_missing,
    values_at_end,
)
from benchmarks.machine import describe_machine, machine_words
from core.errors import ConfigError
from core.jobs import ALONE, open_jobs
from core.learning.config import RewardConfig, RunConfig
from core.learning.runs.named_runs import NAMED_RUNS
from core.text import markdown_table

FOLDER: Final = Path("rallyscope-data/ablation")
REPORT: Final = Path("docs/measured/ablation-report.md")
FIRST_SEED: Final = 31_000
SPEED_MPS: Final = 5.0
Change = Callable[[RunConfig], RunConfig]


def _ddpg(**changes: object) -> Change:
    return lambda run: replace(run, ddpg=replace(run.ddpg, **changes))


def _exploration(**changes: object) -> Change:
    return lambda run: replace(run, exploration=replace(run.exploration, **changes))


CHANGES: Final[dict[str, Change]] = {
    "more updates": _ddpg(updates_per_episode=12, batch=32),
    "current rewards": _ddpg(rewards="current"),
    "faster actor": _ddpg(actor_rate=1e-3),
    "falling rates": _ddpg(final_rate=0.2),
    "more noise": _exploration(smallest=0.06),
    "wider networks": _ddpg(hidden=128),
    "edge penalty": _ddpg(edge_penalty=1.0),
    "random balls first": _exploration(random_episodes=32),
}
"""One suspect each: what it makes of a run."""


def experiments(seeds: int, first_seed: int = FIRST_SEED, shorten: int = 1) -> tuple[Experiment, ...]:
    """Every row of the table, with so many seeds; `shorten` divides episodes, for a test."""
    base = NAMED_RUNS["paper"]
    rows = {
        "paper": base,
        "steady": NAMED_RUNS["steady"],
        "placing": NAMED_RUNS["placing"],
        "placing + narrower networks": _ddpg(hidden=64)(NAMED_RUNS["placing"]),
        "placing + fewer updates": _ddpg(updates_per_episode=4)(NAMED_RUNS["placing"]),
        "straight": paper(stages((SPEED_MPS,), (1700,)), reward=RewardConfig(kind="case")),
        **{f"paper + {name}": change(base) for name, change in CHANGES.items()},
    }
    found = []
    for name, config in rows.items():
        episodes = tuple(max(2, n // shorten) for n in config.curriculum.episodes)
        curriculum = replace(config.curriculum, episodes=episodes)
        every = max(1, config.checkpoint_every // shorten)
        config = replace(config, curriculum=curriculum, checkpoint_every=every, seeds=seeds, first_seed=first_seed)
        found.append(Experiment(name, config))
    return tuple(found)


def table(rows: Sequence[Experiment], results: Results) -> str:
    """A row per experiment that has seeds, in order."""
    paper_mm = _errors(results["paper"])
    cells = [_row(one.name, results[one.name], paper_mm) for one in rows if results[one.name]]
    titles = ("run", "seeds", "returned, %", "error, mm", "worst seed", "five best, mm", "against paper, mm")
    return markdown_table(titles, cells)


def _row(name: str, found: Sequence[SeedResult], paper_mm: Mapping[int, float]) -> tuple[str, ...]:
    ours_mm = _errors(found)
    return (
        name,
        str(len(found)),
        shown("returned", values_at_end(found, SPEED_MPS, "returned")),
        shown("error_mm", list(ours_mm.values())),
        f"{max(ours_mm.values()):.0f}",
        shown("error_mm", [one.five_best_mm(SPEED_MPS) for one in found]),
        "" if name == "paper" else _against(ours_mm, paper_mm),
    )


def _errors(found: Sequence[SeedResult]) -> dict[int, float]:
    """Error in mm of the last policy of each seed."""
    return {one.seed: last.error_mm for one in found if (last := one.last(SPEED_MPS)) is not None}


def _against(ours_mm: Mapping[int, float], paper_mm: Mapping[int, float]) -> str:
    """Mean paired difference on the seeds that both have, and their number; rows may be trained one after another."""
    both = ours_mm.keys() & paper_mm.keys()
    if len(both) < 2:
        return "-"
    sides = [{seed: side[seed] for seed in both} for side in (ours_mm, paper_mm)]
    _, ours, theirs = pair_by_seed(*sides, where="ablation")
    found = paired_difference(ours, theirs)
    return f"{found.estimate:+.0f} [{found.low:+.0f}, {found.high:+.0f}], {found.count} seeds"


INTRODUCTION: Final = """# What makes the paper's agent unsteady

Made by `python -m benchmarks.learning.ablation`, which goes on where it was interrupted. *paper*: the default of
`rallyscope train`, 800 balls at 3 m/s and 900 at 5 m/s; *steady*: `train --preset steady`, the same rules with changes
of ours; *straight*: 1,700 balls at 5 m/s with the *case* reward; *placing*: `train --preset placing`, without the
paper's rules; *X + Y* with one change. Every figure is of the last policy of a seed on the 500 fixed balls of 5 m/s:
mean ± standard deviation over seeds [95 % interval of the mean]; *five best* as in the
[report on learning](learning-report.md). Last column: mean paired difference to *paper* with its 95 % interval. Aimed
at, over 20 seeds: *steady* at most 60 mm, its worst seed 110; *placing* at most 30 mm. With fewer seeds neither is
shown. What each change is: [learning](../how/learning.md#what-makes-the-papers-agent-unsteady).
"""


def write_report(path: Path, rows: Sequence[Experiment], results: Results) -> None:
    """The page with the table."""
    first = rows[0].config.first_seed
    machine = machine_words(describe_machine("numpy", "torch"))
    text = f"{INTRODUCTION}\nSeeds from {first} on. Machine: {machine}.\n\n{table(rows, results)}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def run(rows: Sequence[Experiment], folder: Path, report: Path, only: Sequence[str] = ()) -> Results:
    """Train what is missing, a seed of every row at a time, and write the page after each seed; gives all results.

    Raises:
        ConfigError: if there is no row of a name in `only`.
    """
    names = [one.name for one in rows]
    for name in only:
        if name not in names:
            raise ConfigError("no such row", expected=", ".join(names), got=name, where="only")
    wanted = [one for one in rows if not only or one.name in only]
    for piece in missing_seeds(seeds_in_turn(wanted), folder):
        with open_jobs(ALONE, 1) as jobs:
            train_missing(jobs, [piece], folder, lambda share: None)
        write_report(report, rows, load_results(rows, folder))
    return load_results(rows, folder)


def main() -> None:
    """Read the arguments, run, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--only", nargs="*", default=[], metavar="ROW")
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--report", type=Path, default=REPORT)
    asked = parser.parse_args()
    rows = experiments(asked.seeds)
    print(table(rows, run(rows, asked.folder, asked.report, asked.only)))


if __name__ == "__main__":
    main()
