"""Does a label survive? Kills of a process that labels, several that write at once, and what a durable label costs."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labels.database.connection import transaction
from labels.database.edit_log import add_edit
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore, Layer

UUID = "00000000-0000-4000-8000-000000000001"
LAYER = Layer(UUID, "left", "trial")
STEP_US = 1000


def trial_label(index: int, t_us: int | None = None) -> Label:
    """A label as the app makes them, with everything filled in; `index` can be read back from its position."""
    t_us = index * STEP_US if t_us is None else t_us
    provenance = Provenance(
        source=PositionSource.SNAPPED, window_us=(t_us, t_us + 2000), rendering="polarity", time_spent_ms=900
    )
    return Label(
        t_us=t_us,
        state=LabelState.VISIBLE,
        x_px=index * 0.125,
        y_px=200.5,
        r_px=7.5,
        covariance_px2=(0.01, 0.0, 0.02),
        provenance=provenance,
    )


@dataclass(frozen=True, slots=True)
class KillResult:
    """What was found after one SIGKILL."""

    acknowledged: int
    lost: int
    readable: bool
    resumed: bool
    """Whether labelling went on, and an undo took back exactly the last label."""


def kill_while_labelling(folder: Path, delay_s: float) -> KillResult:
    """Let a process put labels and report each one that it was told is saved; SIGKILL it after `delay_s` of that."""
    command = [sys.executable, "-m", "benchmarks.labels.durability", str(folder), LAYER.annotator, str(10**9)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        first = writer.stdout.readline()
        time.sleep(delay_s)
        writer.kill()
        reported = first + writer.stdout.read()
    whole = [int(line) for line in reported.split(b"\n")[:-1] if line]
    try:
        with LabelStore.open(folder, UUID, LAYER.camera, LAYER.annotator) as store:
            found = dict(zip(store.labels().t_us.tolist(), store.labels().x_px.tolist(), strict=True))
            lost = sum(found.get(index * STEP_US) != trial_label(index).x_px for index in whole)
            next_index = len(found)
            store.put(trial_label(next_index))
            resumed = store.undo() == (next_index * STEP_US,) and len(store.labels()) == len(found)
    except Exception:  # noqa: BLE001 (any failure to open counts as an unreadable store)
        return KillResult(len(whole), len(whole), readable=False, resumed=False)
    return KillResult(len(whole), lost, readable=True, resumed=resumed)


def write_seconds(folder: Path, count: int, *, already: int) -> np.ndarray:
    """Seconds of each of `count` durable puts into a store that holds `already` labels."""
    with LabelStore.open(folder, UUID, LAYER.camera, f"cost-{already}") as store:
        if already:
            store.edit(put=[trial_label(index) for index in range(already)])
        seconds = np.empty(count)
        for row in range(count):
            label = trial_label(already + row)
            before = time.perf_counter()
            store.put(label)
            seconds[row] = time.perf_counter() - before
    return seconds


def open_cpu_seconds(folder: Path, count: int, *, times: int = 5) -> np.ndarray:
    """CPU seconds of this thread for opening a store of `count` edits of a label each, until all are known."""
    with LabelStore.open(folder, UUID, LAYER.camera, f"open-{count}") as store:
        _add_one_by_one(store, count)
    seconds = np.empty(times)
    for row in range(times):
        before = time.thread_time()
        with LabelStore.open(folder, UUID, LAYER.camera, f"open-{count}") as store:
            found = len(store.labels())
        seconds[row] = time.thread_time() - before
        assert found == count
    return seconds


def _add_one_by_one(store: LabelStore, count: int) -> None:
    """As many edits, but made durable once: 200,000 waits for the disk would take minutes."""
    with store.writing() as db, transaction(db):
        for index in range(count):
            add_edit(db, store.writer, (trial_label(index),), ())


@dataclass(frozen=True, slots=True)
class CrowdResult:
    """What was found after several processes had written one store at once."""

    acknowledged: int
    lost: int
    doubled: int
    seconds: float


def write_in_a_crowd(folder: Path, annotators: int, count: int) -> CrowdResult:
    """Let so many processes, each an annotator, put `count` labels each, all into the store of one recording."""
    names = [f"crowd-{number}" for number in range(annotators)]
    begun_s = time.perf_counter()
    writers = [
        subprocess.Popen([sys.executable, "-m", "benchmarks.labels.durability", str(folder), name, str(count)],
                         stdout=subprocess.PIPE)
        for name in names
    ]  # fmt: skip
    reported = [[int(line) for line in writer.communicate()[0].split()] for writer in writers]
    seconds = time.perf_counter() - begun_s
    lost = doubled = 0
    for name, acknowledged in zip(names, reported, strict=True):
        layer = Layer(UUID, LAYER.camera, name)
        with closing(sqlite3.connect(layer.path(folder))) as db:
            query = "SELECT t_us, count(*) FROM history WHERE annotator = ? GROUP BY t_us"
            edits = dict(db.execute(query, (name,)).fetchall())
        found = LabelStore.read(folder, layer).by_time()
        lost += sum(index * STEP_US not in found for index in acknowledged)
        doubled += sum(times - 1 for times in edits.values())
    return CrowdResult(sum(map(len, reported)), lost, doubled, seconds)


def undo_everything(folder: Path, operations: int, rng: np.random.Generator) -> tuple[int, bool]:
    """Random edits, deletions, undos and redos, then undo to the end and redo to the end.

    Returns how many labels are left after undoing everything, and whether redoing everything leads back.
    """
    with LabelStore.open(folder, UUID, LAYER.camera, "undo") as store:
        for index in range(operations):
            t_us = int(rng.integers(operations // 4)) * STEP_US
            act = rng.random()
            if act < 0.5:
                store.put(trial_label(index, t_us))
            elif act < 0.6:
                times = rng.choice(operations, 5, replace=False) * STEP_US
                store.edit(put=[trial_label(index, int(time_us)) for time_us in times])
            elif act < 0.75:
                store.delete(t_us)
            elif act < 0.9:
                store.undo()
            else:
                store.redo()
        while store.redo():
            pass
        final = store.all()
    with LabelStore.open(folder, UUID, LAYER.camera, "undo") as store:  # after a restart
        while store.undo():
            pass
        left = len(store.labels())
        while store.redo():
            pass
        return left, store.all() == final


def _label(folder: Path, annotator: str, count: int) -> None:
    """Until that many are made, or this process is killed."""
    with LabelStore.open(folder, UUID, LAYER.camera, annotator) as store:
        for index in range(len(store.labels()), count):
            store.put(trial_label(index))
            os.write(1, b"%d\n" % index)  # unbuffered: what is reported here has been acknowledged


if __name__ == "__main__":
    _label(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
