"""What a piece of work costs beside the work: pieces that do nothing, in processes and on a cluster of this machine.

A piece is a recording of a data set to be made, as `simulate` sends it, and its result is one number.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

from benchmarks.jobs.counting_relay import counting_relay
from benchmarks.jobs.loopback_cluster import loopback_cluster
from benchmarks.machine import Row, describe_machine, goal_row
from core.data_sets import plan_data_set
from core.data_sets.plan import PlannedRecording
from core.jobs import JobBackend, TaskControl, open_jobs

COUNT: Final = 1000
WORKERS: Final = (1, 2)
GOAL_MS: Final = 5.0
COUNTED: Final = 200
"""Pieces whose bytes are counted, through a relay that would slow down the others."""


def run(progress: Callable[[float], None], *, count: int = COUNT) -> dict[str, object]:
    """A row for each engine and number of workers: time and bytes of a piece; whether the goal is met; the machine."""
    pieces = plan_data_set(speeds_mps=(5.0,), recordings_per=count).recordings
    rows: list[Row] = []
    steps = 2 * len(WORKERS)
    for workers in WORKERS:
        rows.append(
            _row("processes", workers, pieces, JobBackend(jobs=max(2, workers)), None) if workers > 1 else _here(pieces)
        )
        progress(len(rows) / steps)
        with loopback_cluster(workers) as address:
            moved = _bytes_moved(address, pieces[:COUNTED])
            rows.append(_row("cluster", workers, pieces, JobBackend(cluster=address), moved))
        progress(len(rows) / steps)
    slowest = max(float(str(row["ms_per_piece"])) for row in rows)
    goals = [goal_row("overhead of a piece, slowest row", slowest, GOAL_MS, "ms")]
    return {"rows": rows, "goals": goals, "pieces": count, "machine": describe_machine("distributed", "numpy")}


def do_nothing(planned: PlannedRecording, control: TaskControl) -> int:
    """As long as the piece's name is."""
    return len(planned.name)


def _here(pieces: Sequence[PlannedRecording]) -> Row:
    return _row("this process", 1, pieces, JobBackend(jobs=1), None)


def _row(
    engine: str, workers: int, pieces: Sequence[PlannedRecording], where: JobBackend, moved: tuple[float, float] | None
) -> Row:
    with open_jobs(where, len(pieces)) as jobs:
        jobs.run(do_nothing, pieces[:50])  # until everything has started
        started_s = time.perf_counter()
        jobs.run(do_nothing, pieces)
        taken_s = time.perf_counter() - started_s
    sent, received = moved or (None, None)
    return {
        "engine": engine,
        "workers": workers,
        "ms_per_piece": float(f"{1e3 * taken_s / len(pieces):.3g}"),
        "pieces_per_s": round(len(pieces) / taken_s, 1),
        "bytes_sent": sent,
        "bytes_received": received,
    }


def _bytes_moved(address: str, pieces: Sequence[PlannedRecording]) -> tuple[float, float]:
    """Of a piece, between this process and the scheduler: sent and received."""
    with counting_relay(address) as relay, open_jobs(JobBackend(cluster=relay.address), len(pieces)) as jobs:
        jobs.run(do_nothing, pieces[:20])
        before = relay.sent_bytes, relay.received_bytes
        jobs.run(do_nothing, pieces)
        sent, received = relay.sent_bytes - before[0], relay.received_bytes - before[1]
    return round(sent / len(pieces)), round(received / len(pieces))
