"""Damaged files of ours: each gives its good part with a note, or one clear line, soon and without much memory.

Every trial damages a whole file by the seed and the number of the trial, and opens it in a child process as the app and
the command line do. What is no good part and no clear line is a bug; the first trial of each is printed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from benchmarks.damage.trials import DamageCounts, run_damage_trials
from benchmarks.machine import Row, describe_machine, goal_row
from benchmarks.partial_rows import report_rows_to, within
from core.errors import CommandError

COUNT: Final = 10_000
SEED: Final = 16
KINDS: Final = {
    "recording, by its meaning": "benchmarks.damage.recording_kinds:MEANING",
    "recording, by its bytes": "benchmarks.damage.recording_kinds:BYTES",
    "recording of a killed writer": "benchmarks.damage.recording_kinds:LOG",
    "label store": "benchmarks.app.damaged_label_stores:STORES",
    "training run": "benchmarks.damage.run_kinds:RUNS",
    "config": "benchmarks.damage.text_kinds:CONFIGS",
    "calibration": "benchmarks.damage.text_kinds:CALIBRATIONS",
    "manifest": "benchmarks.damage.text_kinds:MANIFESTS",
    "index of a data set": "benchmarks.damage.index_kinds:INDEXES",
}
"""Every kind of file of ours, and where its trials are."""


def run(progress: Callable[[float], None], *, count: int = COUNT, only: str | None = None) -> dict[str, object]:
    """Of every kind, or `only` one, so many damages: how many were bugs, deaths of the process, too slow or too large.

    Raises:
        CommandError: if there is no such kind.
    """
    kinds = choose_kinds(only)
    rows: list[Row] = []
    problems: list[str] = []
    for number, (name, kind) in enumerate(kinds.items()):
        share = within(progress, number / len(kinds), (number + 1) / len(kinds))
        counts = run_damage_trials(kind, count, seed=SEED, progress=share)
        found = rows_of(name, counts)
        rows += found
        problems += [
            f"{name}: {times} x {place} ({counts.first_of[place]})" for place, times in counts.problems.items()
        ]
        report_rows_to(progress, found, (number + 1) / len(kinds))
    return {"rows": rows, "problems": problems, "machine": describe_machine("numpy", "h5py")}


def choose_kinds(only: str | None) -> dict[str, str]:
    """All kinds, or one."""
    if only is None:
        return KINDS
    if only not in KINDS:
        raise CommandError("no such kind of file", expected="; ".join(KINDS), got=only, where="--only")
    return {only: KINDS[only]}


def rows_of(name: str, counts: DamageCounts) -> list[Row]:
    """Three figures of one kind, whose goal is none."""
    seen = counts.outcomes
    note = f"{seen['good']} unharmed, {seen['noted']} with notes, {seen['line']} refused in one line"
    ended = seen["died"] + seen["memory"]
    return [
        goal_row(f"{name}: bugs in {counts.trials} damages", seen["bug"], 0, "", note=note),
        goal_row(f"{name}: deaths, or more than 2 GiB", ended, 0, ""),
        goal_row(f"{name}: slower than 20 s", seen["slow"], 0, "", note=f"slowest {counts.slowest_s:.2f} s"),
    ]
