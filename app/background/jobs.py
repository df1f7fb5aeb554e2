"""Long work for one browser: runs beside the loop, reports progress, can be cancelled."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Result = TypeVar("Result")
Progress = Callable[[float], None]


class Job(Generic[Result]):
    """One run of `work(progress, cancelled)` in a thread of its own.

    `done(result)` or `failed(error)` is called from that thread, and neither after a cancel.
    """

    def __init__(
        self,
        work: Callable[[Progress, Callable[[], bool]], Result],
        done: Callable[[Result], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._work = work
        self._done = done
        self._failed = failed
        self._cancel = threading.Event()
        self.share = 0.0
        """Share of the work that is done, 0..1."""
        self._thread = threading.Thread(target=self._run, name="rallyscope-job", daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether its thread is running."""
        return self._thread.is_alive()

    def cancel(self) -> None:
        """Ask it to stop; no callback is called any more."""
        self._cancel.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait for its end; whether it ended within this time."""
        self._thread.join(timeout_s)
        return not self.running

    def _run(self) -> None:
        try:
            result = self._work(self._report, self._cancel.is_set)
            if not self._cancel.is_set():
                self._done(result)
        except Exception as error:  # noqa: BLE001 (whoever started the job hears of any)
            if not self._cancel.is_set():
                self._failed(error)

    def _report(self, share: float) -> None:
        self.share = share


class LoopJob(Generic[Result]):
    """Long work for one browser, one job at a time, whose outcome is handled by the browser's loop.

    Methods are called by the loop. Of a job that was cancelled nothing is handled any more.
    """

    def __init__(
        self,
        later: Callable[[Callable[[], None]], None],
        failed: Callable[[Exception], None],
        ended: Callable[[], None] = lambda: None,
    ) -> None:
        """`later` runs a function in the loop. `ended` is called before a result is handled, or after a cancel."""
        self._later = later
        self._failed = failed
        self._ended = ended
        self._job: Job[Result] | None = None

    @property
    def running(self) -> bool:
        """Whether a job runs, or its result is not handled yet."""
        return self._job is not None

    @property
    def share(self) -> float | None:
        """Share of the work done, 0..1; None if nothing runs."""
        return None if self._job is None else self._job.share

    def start(self, work: Callable[[Progress, Callable[[], bool]], Result], done: Callable[[Result], None]) -> None:
        """Run `work(progress, cancelled)` in a thread of its own; the loop calls `done(result)`."""
        self.close()
        job: Job[Result] = Job(
            work,
            lambda result: self._later(lambda: self._end(job, lambda: done(result))),
            lambda error: self._later(lambda: self._end(job, lambda: self._failed(error))),
        )
        self._job = job

    def cancel(self) -> None:
        """Cancel the job; its result is dropped."""
        if self._job is not None:
            self.close()
            self._ended()

    def close(self) -> None:
        """The browser has disconnected."""
        if self._job is not None:
            self._job.cancel()
            self._job = None

    def _end(self, job: Job[Result], then: Callable[[], None]) -> None:
        if self._job is job:  # else it was cancelled just then
            self._job = None
            self._ended()
            then()
