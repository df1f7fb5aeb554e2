"""Running the tasks of a job on any backend, with equal results."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Final, Protocol, TypeVar, cast
from urllib.parse import urlsplit

from threadpoolctl import threadpool_limits

from core.errors import CommandError, JobsError
from core.files import usable_cores
from core.jobs.control import CallbackControl, TaskControl, TasksStoppedError
from core.jobs.local_executor import LocalExecutor
from core.text import is_loopback


@dataclass(frozen=True, slots=True, kw_only=True)
class JobBackend:
    """Processes of this machine, or the workers of a Dask cluster."""

    jobs: int | None = None
    """Tasks at a time on this machine; None for one per core."""
    cluster: str | None = None
    """Address of the cluster's scheduler, `tcp://` on this machine and `tls://` beyond it; None for here."""

    def __post_init__(self) -> None:
        if self.jobs is not None and self.jobs < 1:
            raise JobsError("no such number of jobs", expected="at least 1", got=self.jobs)
        if self.cluster is not None:
            if self.jobs is not None:
                raise JobsError("a cluster has its own number of workers", remedy="give jobs or a cluster, not both")
            _check_address(self.cluster)

    def processes(self, most: int) -> int:
        """Number of processes on this machine for at most `most` tasks."""
        return max(1, min(self.jobs or usable_cores(), most))


HERE: Final = JobBackend()
"""One process per core of this machine."""
ALONE: Final = JobBackend(jobs=1)
"""This process only."""


def _check_address(address: str) -> None:
    """Raise JobsError unless the connection to the cluster is local or encrypted."""
    expected = "tcp://127.0.0.1:PORT or tls://HOST:PORT"
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise JobsError("not the address of a cluster", expected=expected, got=repr(address[:100])) from error
    if parts.scheme not in ("tcp", "tls") or not host or not port or parts.path or parts.query or parts.username:
        raise JobsError("not the address of a cluster", expected=expected, got=repr(address[:100]))
    if parts.scheme == "tcp" and not is_loopback(host):
        remedy = "start scheduler and workers with --tls-ca-file, --tls-cert and --tls-key, or use `ssh -L`"
        raise JobsError(
            "a cluster beyond this machine needs certificates",
            expected="tls://",
            got=repr(address[:100]),
            remedy=remedy,
        )


LOOK_S: Final = 0.1
"""Interval of progress reports and checks for a cancel, s."""

P = TypeVar("P")
R = TypeVar("R")
Work = Callable[[P, TaskControl], R]
"""A function of a module, or a frozen value with `__call__`: it is pickled for other processes, with each task."""


class TaskExecutor(Protocol):
    """An executor of `concurrent.futures` whose functions are given a control as their last argument."""

    @property
    def blames_one(self) -> bool:
        """Whether the death of a process loses only the task it was working on."""
        ...

    def submit(self, fn: Callable[..., R], /, *args: object) -> Future[R]:
        """Run `fn(*args, control)` on a worker."""
        ...

    def shares(self) -> float:
        """Sum of the progress, 0 to 1 each, of the running tasks."""
        ...

    def check(self) -> None:
        """Raise JobsError if the backend is gone."""
        ...

    def is_lost(self, error: BaseException) -> bool:
        """Whether a task failed because the processes that worked on it died."""
        ...

    def check_file(self, path: Path) -> None:
        """Raise JobsError if a worker does not see a file, or sees a different one."""
        ...


class Jobs:
    """Runs batches of tasks, one batch at a time. Made by `open_jobs`."""

    def __init__(self, executor: TaskExecutor | None) -> None:
        self._executor = executor

    def share_file(self, path: Path) -> Path:
        """Absolute path of a file that all workers see.

        Raises:
            JobsError: if a worker of the cluster does not see it, or sees another.
        """
        path = path.absolute()
        if self._executor is not None:
            self._executor.check_file(path)
        return path

    def share_folder(self, folder: Path) -> Path:
        """Absolute path of a folder that all workers see; it is created if missing.

        Raises:
            JobsError: if a worker of the cluster does not see it, or nothing can be written there.
        """
        folder = folder.absolute()
        mark = folder / f".seen-{uuid.uuid4().hex}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            mark.touch()
            self.share_file(mark)
        except OSError as error:
            raise JobsError("nothing can be written there", got=error.strerror, where=folder) from error
        finally:
            with suppress(OSError):
                mark.unlink()
        return folder

    def run(
        self,
        work: Work[P, R],
        pieces: Sequence[P],
        *,
        name: Callable[[P], str] | None = None,
        done: Callable[[int, R], None] = lambda number, result: None,
        progress: Callable[[float], None] = lambda share: None,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> list[R]:
        """The result of each piece, in their order.

        `done` hears the number and the result of a piece as soon as it has ended, `progress` the share of all that is
        done, both in this thread. A piece whose processes die is tried again a few times; then the others go on without
        it, and one line at the end names it (by its `name`). An error that a piece raises is raised here at once.

        Raises:
            TasksStoppedError: soon after `cancelled()` has become true.
            JobsError: if pieces were lost, or the cluster is gone.
        """
        if self._executor is None:
            return _run_here(work, pieces, done, progress, cancelled)
        batch = _Batch(self._executor, work, pieces, name or _numbered(pieces))
        return batch.run(done, progress, cancelled)


@contextmanager
def open_jobs(engine: JobBackend, most: int) -> Iterator[Jobs]:
    """Yields what works on pieces; there will be at most `most` at a time.

    A single process is this one. However the block ends, no process and nothing on the cluster goes on with it.

    Raises:
        JobsError: if the cluster cannot be used.
        CommandError: without dask.
    """
    if engine.cluster is None and engine.processes(most) == 1:
        with threadpool_limits(1):
            yield Jobs(None)
        return
    executor = _open_executor(engine, most)
    try:
        yield Jobs(cast(TaskExecutor, executor))
    except BaseException:  # Ctrl-C too: do not wait for tasks that take minutes
        executor.shutdown(wait=True, cancel_futures=True)
        raise
    executor.shutdown(wait=True)


def _open_executor(engine: JobBackend, most: int) -> Executor:
    if engine.cluster is None:
        return LocalExecutor(engine.processes(most))
    try:
        from core.jobs.cluster import ClusterExecutor  # imported late: an optional dependency that takes a second
    except ImportError as error:
        raise CommandError("a cluster needs dask", remedy="pip install 'rallyscope[cluster]'") from error
    return ClusterExecutor(engine.cluster)


def _numbered(pieces: Sequence[P]) -> Callable[[P], str]:
    numbers = {id(piece): number for number, piece in enumerate(pieces, 1)}
    return lambda piece: f"number {numbers[id(piece)]}"


def _run_here(
    work: Work[P, R],
    pieces: Sequence[P],
    done: Callable[[int, R], None],
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> list[R]:
    results: list[R] = []
    for number, piece in enumerate(pieces):
        if cancelled():
            raise TasksStoppedError
        control = CallbackControl(lambda share, number=number: progress((number + share) / len(pieces)), cancelled)
        results.append(work(piece, control))
        done(number, results[-1])
        progress((number + 1) / len(pieces))
    return results


class _Batch:
    """The tasks of one call of `run`."""

    def __init__(self, executor: TaskExecutor, work: Work[P, R], pieces: Sequence[P], name: Callable[[P], str]) -> None:
        self._executor, self._work, self._pieces, self._name = executor, work, pieces, name
        self._ended: SimpleQueue[tuple[int, Future]] = SimpleQueue()
        self._results: dict[int, object] = {}
        self._lost: list[int] = []
        self._shown = self._looked_s = 0.0

    def run(self, done: Callable[[int, R], None], progress: Callable[[float], None], cancelled: Callable) -> list:
        count = len(self._pieces)
        self._finish(range(count), done, progress, cancelled)
        if not self._executor.blames_one:  # find the failing task by running each again, alone
            suspects, self._lost = sorted(self._lost), []
            for number in suspects:
                self._finish([number], done, progress, cancelled)
        if self._lost:
            raise self._gave_up()
        progress(1.0)
        return [self._results[number] for number in range(count)]

    def _finish(
        self,
        numbers: Sequence[int],
        done: Callable[[int, R], None],
        progress: Callable[[float], None],
        cancelled: Callable,
    ) -> None:
        for number in numbers:
            future = self._executor.submit(self._work, self._pieces[number])
            future.add_done_callback(lambda ended, number=number: self._ended.put((number, ended)))
        left = len(numbers)
        while left:
            if time.monotonic() - self._looked_s >= LOOK_S:
                self._look(progress, cancelled)
            with suppress(Empty):
                number, future = self._ended.get(timeout=LOOK_S)
                left -= 1
                if self._keep(number, future):
                    done(number, cast(R, self._results[number]))

    def _look(self, progress: Callable[[float], None], cancelled: Callable[[], bool]) -> None:
        self._looked_s = time.monotonic()
        self._executor.check()
        if cancelled():
            raise TasksStoppedError
        share = (len(self._results) + self._executor.shares()) / len(self._pieces)
        self._shown = max(self._shown, min(1.0, share))
        progress(self._shown)

    def _keep(self, number: int, future: Future) -> bool:
        """Store a task's result; whether it has one."""
        try:
            self._results[number] = future.result()
        except CancelledError as error:
            self._executor.check()
            raise JobsError("the cluster has dropped the work", remedy="run it again; what is done stays") from error
        except Exception as error:
            if not self._executor.is_lost(error):
                raise
            self._lost.append(number)
            return False
        return True

    def _gave_up(self) -> JobsError:
        names = ", ".join(self._name(self._pieces[number]) for number in sorted(self._lost))
        what = f"{len(self._lost)} of {len(self._pieces)} pieces of work were given up: every process that tried died"
        return JobsError(
            what, got=names, remedy="run it again with more memory for each, or fewer jobs; what is done stays"
        )
