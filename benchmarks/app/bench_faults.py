"""Faults while a job writes: what was acknowledged is there, the ending is one clear line, the next start works.

Jobs are recording, import, labelling, training, export, data set and tune; faults a kill (SIGKILL), a disk that is
full, a device that fails, a folder that cannot be written, a process that stops for a while (SIGSTOP), a wall clock
that is stepped by an hour, a worker that is killed as for its memory, and a power cut. All but the folder come at
random moments. A power cut is not made: it is counted what was not synced at the end.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final, get_args

import numpy as np

from benchmarks.app.faults.jobs import JOBS
from benchmarks.app.faults.trials import FaultName, FaultResult, FaultTrials
from benchmarks.machine import Row, describe_machine, goal_row
from benchmarks.partial_rows import report_rows_to
from core.errors import CommandError

COUNT: Final = 100
SEED: Final = 16
ONCE: Final = ("read-only folder", "power cut")
"""Nothing about them is random."""
IN_PARALLEL: Final = ("killed", "worker killed")
"""Of work in several processes; the other faults are tried on the same work in one."""
PAUSE_S: Final = 60.0
STOPS: Final = 1


def run(progress: Callable[[float], None], *, count: int = COUNT, only: str | None = None) -> dict[str, object]:
    """Of every fault and job so many trials: what was lost, and which endings were unclear."""
    pairs = choose_pairs(only)
    rows: list[Row] = []
    problems: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="rallyscope-faults-") as folder:
        for name in dict.fromkeys(job for job, _ in pairs):
            trials = FaultTrials(JOBS[name], Path(folder) / name.replace(" ", "-"))
            for job, fault in pairs:
                if job != name:
                    continue
                results = try_often(trials, fault, count)
                found = rows_of(f"{fault}, {name}", results)
                rows += found
                problems.update(f"{fault}, {name}: {result.unclear}" for result in results if result.unclear)
                report_rows_to(progress, found, len(rows) / 2 / len(pairs))
    return {"rows": rows, "problems": dict(problems), "machine": describe_machine("numpy", "h5py")}


def choose_pairs(only: str | None) -> list[tuple[str, FaultName]]:
    """Jobs and the faults that are tried on them; `only` is a fault or a job."""
    pairs: list[tuple[str, FaultName]] = [
        (name, fault)
        for name, job in JOBS.items()
        for fault in get_args(FaultName)
        if not (job.sqlite and fault in ("device error", "power cut"))
        and (fault in IN_PARALLEL if job.workers else fault != "worker killed")
    ]
    if only is None:
        return pairs
    chosen = [pair for pair in pairs if only in pair]
    if not chosen:
        known = ", ".join([*get_args(FaultName), *JOBS])
        raise CommandError("no such fault, and no such job", expected=known, got=only, where="--only")
    return chosen


def try_often(trials: FaultTrials, fault: FaultName, count: int, *, pause_s: float = PAUSE_S) -> list[FaultResult]:
    """So many trials; fewer of what takes a minute, and one of what is the same each time."""
    times = 1 if fault in ONCE else min(count, STOPS) if fault == "stopped" else count
    return [trials.try_fault(fault, np.random.default_rng((SEED, k)), pause_s=pause_s) for k in range(times)]


def rows_of(name: str, results: list[FaultResult]) -> list[Row]:
    """Two figures of one fault and job, whose goal is none."""
    struck = sum(result.struck for result in results)
    unclear = [result.unclear for result in results if result.unclear]
    return [
        goal_row(f"{name}: lost", sum(r.lost for r in results), 0, "", note=f"{len(results)} trials, {struck} struck"),
        goal_row(f"{name}: unclear endings", len(unclear), 0, "", note=unclear[0][:100] if unclear else ""),
    ]
