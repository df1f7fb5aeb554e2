"""Make a data set in parallel: a process per core, each making one recording at a time on one thread."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import RecordingError
from core.files import end_with_parent, hold, usable_cores
from core.rally.data_sets.card import write_card
from core.rally.data_sets.facts import RecordingFacts, read_facts
from core.rally.data_sets.make import make_recording, recording_path, remove_partials
from core.rally.data_sets.plan import DataSetPlan, PlannedRecording

LOCK: Final = ".data-set.lock"
LOOK_S: Final = 0.2
"""How often the progress is looked at."""

Progress = Callable[[float], None]
Shares = Sequence[float]


@dataclass(frozen=True, slots=True)
class DataSetRun:
    """What a run did."""

    folder: Path
    made: tuple[str, ...]
    """Names of the recordings that it made."""
    kept: tuple[str, ...]
    """Those that were there."""
    manifest: dict[str, object]


def run_data_set(
    plan: DataSetPlan,
    folder: Path,
    *,
    jobs: int | None = None,
    overwrite: bool = False,
    progress: Progress = lambda share: None,
) -> DataSetRun:
    """Make the recordings of the plan that are not there yet, and write the card after each.

    What is there stays, if it was made with the same settings. `jobs` processes work at a time, one per core unless
    told otherwise; the recordings do not depend on it. Ending this process, however it is done, ends the others, and no
    unfinished recording has a final name.

    Raises:
        RecordingError: if a recording there has other settings, another run works in the folder, or writing fails.
        ConfigError: if a serve is impossible.
    """
    with _locked(folder), _told_in_one_line(folder):
        remove_partials(folder)
        facts: dict[str, RecordingFacts] = {}
        for planned in plan.recordings:
            path = recording_path(folder, planned)
            if path.exists() and not overwrite:
                facts[planned.name] = read_facts(path, planned)
        kept = tuple(facts)
        missing = [planned for planned in plan.recordings if planned.name not in facts]
        manifest = write_card(folder, plan, facts)

        def done(planned: PlannedRecording) -> None:
            nonlocal manifest
            facts[planned.name] = read_facts(recording_path(folder, planned), planned)
            manifest = write_card(folder, plan, facts)

        workers = min(jobs or usable_cores(), len(missing))
        if workers > 1:
            _make_in_parallel(missing, folder, workers, progress, done)
        else:
            _make_here(missing, folder, progress, done)
        return DataSetRun(folder, tuple(planned.name for planned in missing), kept, manifest)


@contextmanager
def _told_in_one_line(folder: Path) -> Iterator[None]:
    """A disk that refuses something, here or in a worker, is no bug."""
    try:
        yield
    except OSError as error:
        remedy = "free some space and run it again; what is done stays"
        got = error.strerror or error
        raise RecordingError("the data set cannot be written", got=got, where=folder, remedy=remedy) from error


def _locked(folder: Path) -> AbstractContextManager[object]:
    """The folder, made if need be, for this run alone."""
    try:
        return hold(folder / LOCK)
    except TimeoutError as error:
        raise RecordingError("another run is making this data set", where=folder, remedy="wait for its end") from error
    except OSError as error:
        raise RecordingError("cannot make the data set's folder", got=error.strerror, where=folder) from error


def _make_here(
    missing: Sequence[PlannedRecording], folder: Path, progress: Progress, done: Callable[[PlannedRecording], None]
) -> None:
    for number, planned in enumerate(missing):
        make_recording(planned, folder, lambda share, number=number: progress((number + share) / len(missing)))
        done(planned)
        progress((number + 1) / len(missing))


def _make_in_parallel(
    missing: Sequence[PlannedRecording],
    folder: Path,
    workers: int,
    progress: Progress,
    done: Callable[[PlannedRecording], None],
) -> None:
    context = multiprocessing.get_context("spawn")  # a fork would copy the threads' locks
    shares = context.Array("d", len(missing), lock=False)
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker, initargs=(shares,))
    try:
        running: dict[Future[None], PlannedRecording] = {
            pool.submit(_work, planned, folder, number): planned for number, planned in enumerate(missing)
        }
        while running:
            ended, _ = wait(running, timeout=LOOK_S, return_when=FIRST_EXCEPTION)
            ended |= {future for future in running if future.done()}
            for future in ended:
                planned = running.pop(future)
                future.result()
                done(planned)
            progress(sum(shares) / len(missing))
    except BaseException as error:  # Ctrl-C too: do not wait for recordings that take minutes
        for process in set(multiprocessing.active_children()) - others:
            process.kill()  # one that hangs, or was stopped, would not hear anything politer
        if not isinstance(error, BrokenProcessPool):
            raise
        remedy = "run it again with fewer --jobs; what is done stays"
        raise RecordingError("a process that made recordings died", where=folder, remedy=remedy) from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        remove_partials(folder)


_shares: list[float] | None = None
"""Of a worker: how far each recording is, seen by the parent."""


def _start_worker(shares: list[float]) -> None:
    """A worker leaves Ctrl-C to its parent, and ends when that has ended, even killed in the middle of a recording."""
    global _shares
    _shares = shares
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


def _work(planned: PlannedRecording, folder: Path, number: int) -> None:
    assert _shares is not None
    shares = _shares

    def show(share: float) -> None:
        shares[number] = share

    make_recording(planned, folder, show)
    show(1.0)
