"""The figures of labelling: durability, undo, snapping, interpolation, stereo flags, the queue, and shifts of labels.

All balls are simulated; labels made up in the trials are off by 0.4 px, as a careful person's. Times are wall time on
the disk of the temporary folder.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.labels.assistance import (
    HUMAN_SIGMA_PX,
    try_interpolation,
    try_queue,
    try_snap,
    try_stereo_flags,
)
from benchmarks.labels.contact_proposals import figures_of, simulate_contacts
from benchmarks.labels.durability import (
    kill_while_labelling,
    open_cpu_seconds,
    undo_everything,
    write_in_a_crowd,
    write_seconds,
)
from benchmarks.labels.label_shifts import NEAR_PX, NEAR_US, try_shifts
from benchmarks.machine import Row, describe_machine, goal_row, report_rows_to
from labels.database.file_system import JOURNAL_VARIABLE, ROLLBACK

KILLS = 300
SHARED_KILLS = 20
MANY = 200_000
ANNOTATORS = 8
STORED = (0, 20_000, 200_000)
"""Labels that a store has already when a write is timed."""
OPERATIONS = 10_000
"""That are undone and redone."""
SNAPS = 300
RALLIES, DRAWS = 12, 9
"""Of each kind, with labels that were shifted."""
CONTACT_RALLIES, CONTACT_SEED = 24, 3000
"""Rallies whose contacts are proposed. Nothing was chosen on these draws."""
SEED = 20260


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """Every figure: what it is, its goal, what was measured, and whether that is enough."""
    rows: list[Row] = []
    parts = (_durability, _shared_folder, _undo, _snapping, _interpolation, _stereo, _queue, _shifts, _contacts, _scale)
    weights = np.cumsum([0.2, 0.05, 0.1, 0.1, 0.1, 0.02, 0.03, 0.13, 0.04, 0.23])
    with tempfile.TemporaryDirectory(prefix="rallyscope-labels-") as folder:
        for number, part in enumerate(parts):
            found = part(Path(folder) / part.__name__.strip("_"), np.random.default_rng(SEED + number))
            rows += found
            report_rows_to(progress, found, float(weights[number]))
    return {
        "rows": rows,
        "machine": describe_machine("numpy"),
    }


def _durability(folder: Path, rng: np.random.Generator) -> list[Row]:
    results = [kill_while_labelling(folder / f"{number % 10}", float(rng.uniform(0, 0.1))) for number in range(KILLS)]
    acknowledged = sum(result.acknowledged for result in results)
    rows = [
        goal_row(
            f"labels lost in {KILLS} kills", sum(result.lost for result in results), 0, "", note=f"of {acknowledged}"
        ),
        goal_row(f"unreadable stores in {KILLS} kills", sum(not result.readable for result in results), 0, ""),
        goal_row("stores that could not go on", sum(not result.resumed for result in results), 0, ""),
    ]
    for already in STORED:
        ms = 1e3 * write_seconds(folder, 500, already=already)
        rows.append(goal_row(f"durable write p50 at {already} labels", float(np.median(ms)), 5, "ms"))
        rows.append(goal_row(f"durable write p99 at {already} labels", float(np.percentile(ms, 99)), 10, "ms"))
    return rows


def _shared_folder(folder: Path, rng: np.random.Generator) -> list[Row]:
    """Kills and writes as on a folder of a network: a rollback journal, and one writer with a lease."""
    before = os.environ.get(JOURNAL_VARIABLE)
    os.environ[JOURNAL_VARIABLE] = ROLLBACK  # the processes that are killed inherit it
    try:
        results = [kill_while_labelling(folder / f"{n % 4}", float(rng.uniform(0, 0.1))) for n in range(SHARED_KILLS)]
        ms = 1e3 * write_seconds(folder, 200, already=0)
    finally:
        os.environ.pop(JOURNAL_VARIABLE)
        if before is not None:
            os.environ[JOURNAL_VARIABLE] = before
    lost, acknowledged = sum(result.lost for result in results), sum(result.acknowledged for result in results)
    note = "rollback journal with a lease, on a disk of this machine"
    return [
        goal_row(f"shared folder: labels lost in {SHARED_KILLS} kills", lost, 0, "", note=f"of {acknowledged}"),
        goal_row("shared folder: unreadable stores", sum(not result.readable for result in results), 0, ""),
        goal_row("shared folder: stores that could not go on", sum(not result.resumed for result in results), 0, ""),
        goal_row("shared folder: durable write p50", float(np.median(ms)), 20, "ms", note=note),
    ]


def _scale(folder: Path, rng: np.random.Generator) -> list[Row]:
    seconds = open_cpu_seconds(folder, MANY)
    crowd = write_in_a_crowd(folder / "crowd", ANNOTATORS, 250)
    note = (
        f"of {crowd.acknowledged}; {crowd.acknowledged / crowd.seconds:.0f} a second, starts of the programs included"
    )
    what = f"labels in {ANNOTATORS} programs writing at once"
    return [
        goal_row(f"opening {MANY} labels, CPU, median of {len(seconds)}", float(np.median(seconds)), 0.5, "s"),
        goal_row(f"lost {what}", crowd.lost, 0, "", note=note),
        goal_row(f"doubled {what}", crowd.doubled, 0, ""),
    ]


def _undo(folder: Path, rng: np.random.Generator) -> list[Row]:
    left, redone = undo_everything(folder, OPERATIONS, rng)
    return [
        goal_row(f"labels left after undoing {OPERATIONS} operations", left, 0, ""),
        goal_row("redoing them all leads back", float(redone), 1, "", least=True),
    ]


def _snapping(folder: Path, rng: np.random.Generator) -> list[Row]:
    trial = try_snap(SNAPS, rng)
    found = np.isfinite(trial.error_px)
    error = trial.error_px[found]
    note = "0-20 m/s, radius 3-15 px, 5 % noise, clicks 1.5 px off"
    return [
        goal_row("snap median", float(np.median(error)), 0.25, "px", note=note),
        goal_row("snap p95", float(np.percentile(error, 95)), 0.8, "px", note=note),
        goal_row(
            "snap: balls without a circle", float((~found).mean()), 0.03, "", note="nearly all slower than 0.5 m/s"
        ),
        goal_row("snap: errors within two sigma", float((trial.mahalanobis[found] < 6.18).mean()), 0.9, "", least=True),
        goal_row("snap: radius off, median", abs(float(np.nanmedian(trial.radius_ratio)) - 1), 0.02, "", note=note),
        goal_row("snap bias along the motion", float(abs(np.median(trial.along_px[found]))), 0.05, "px"),
    ]


def _interpolation(folder: Path, rng: np.random.Generator) -> list[Row]:
    trial = try_interpolation(8, 10, rng, sigma_px=HUMAN_SIGMA_PX)
    note = (
        f"every 10th of 2 ms frames, linear: {np.median(trial.linear_px):.2f}, {np.percentile(trial.linear_px, 95):.2f}"
    )
    rows = []
    for name, error, share in (
        ("curve in 2D", trial.curve_px, trial.curve_share),
        ("flight in 3D", trial.flight_px, trial.flight_share),
    ):
        rows.append(goal_row(f"{name} median", float(np.median(error)), 0.5, "px", note=note))
        rows.append(goal_row(f"{name} p95", float(np.percentile(error, 95)), 1.5, "px", note=note))
        rows.append(goal_row(f"{name}: frames covered", share, 0.9, "", least=True))
    worst = float(trial.across_px.max(initial=0.0))
    note = f"{len(trial.across_px)} frames: bounces beside a keyframe, within its noise"
    return [*rows, goal_row("worst error across an unseen bounce", worst, 3.0, "px", note=note)]


def _stereo(folder: Path, rng: np.random.Generator) -> list[Row]:
    trial = try_stereo_flags(12, 5.0, rng)
    note = f"errors along the line cannot be seen: {trial.flagged_along:.3f} flagged"
    return [
        goal_row("5 px across the epipolar line: flagged", trial.flagged, 0.99, "", least=True, note=note),
        goal_row("good labels flagged", trial.false_flags, 0.02, ""),
    ]


def _queue(folder: Path, rng: np.random.Generator) -> list[Row]:
    rows = []
    for with_detector in (True, False):
        trial = try_queue(12, rng, with_detector=with_detector)
        what = f"injected errors in the first 10 % of the queue, {'with' if with_detector else 'without'} detector"
        note = f"{trial.injected} among {trial.labels}"
        rows.append(goal_row(what, trial.in_first_tenth, 0.9, "", least=True, note=note))
    return rows


def _contacts(folder: Path, rng: np.random.Generator) -> list[Row]:
    figures = figures_of([simulate_contacts(CONTACT_SEED + number) for number in range(CONTACT_RALLIES)])[0]
    note = f"{figures.found} of {figures.true}; {figures.false} false; p95 {figures.p95_ms:.2f} ms"
    return [
        goal_row("contacts of rallies proposed", figures.found / figures.true, 0.98, "", least=True, note=note),
        goal_row("time error of proposed contacts, median", figures.median_ms, 0.3, "ms"),
    ]


def _shifts(folder: Path, rng: np.random.Generator) -> list[Row]:
    trial = try_shifts(folder, rng, rallies=RALLIES, draws=DRAWS)
    worst = f"worst {trial.errors_us.max():.0f} us, {trial.errors_px.max():.2f} px"
    what = f"shifts of labels found within {NEAR_US / 1e3:g} ms and {NEAR_PX:g} px, of {trial.shifted}"
    return [
        goal_row(what, trial.found / trial.shifted, 0.99, "", least=True, note=worst),
        goal_row("unshifted labels that are said to be so", trial.said_zero / trial.unshifted, 1, "", least=True),
        goal_row("shifts found for labels of another rally", trial.invented, 0, "", note=f"of {trial.unrelated}"),
    ]
