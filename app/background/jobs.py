"""Work off the loop: long work for one browser, with progress, which can be cancelled; work where only the newest
request matters; and work that several browsers ask for at about the same time, done once.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Executor, Future
from contextlib import ExitStack
from typing import Generic, TypeVar

logger = logging.getLogger(__name__)


Result = TypeVar("Result")
Progress = Callable[[float], None]


class Job(Generic[Result]):
    """One run of `work(progress, cancelled)` in a thread of its own.

    `done(result)` or `failed(error)` is called from that thread, and neither after a cancel. What it `holds`, such as a
    name, is free again before that, also if no thread can be started.
    """

    def __init__(
        self,
        work: Callable[[Progress, Callable[[], bool]], Result],
        done: Callable[[Result], None],
        failed: Callable[[Exception], None],
        holds: ExitStack | None = None,
    ) -> None:
        self._work = work
        self._done = done
        self._failed = failed
        self._holds = ExitStack() if holds is None else holds
        self._cancel = threading.Event()
        self.share = 0.0
        """Share of the work that is done, 0..1."""
        self._thread = threading.Thread(target=self._run, name="rallyscope-job", daemon=True)
        try:
            self._thread.start()
        except BaseException:
            self._holds.close()
            raise

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
            try:
                result = self._work(self._report, self._cancel.is_set)
            finally:
                self._holds.close()
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

    def start(
        self,
        work: Callable[[Progress, Callable[[], bool]], Result],
        done: Callable[[Result], None],
        holds: ExitStack | None = None,
    ) -> None:
        """Run `work(progress, cancelled)` in a thread of its own; the loop calls `done(result)`. `holds`: see `Job`."""
        self.close()
        job: Job[Result] = Job(
            work,
            lambda result: self._later(lambda: self._end(job, lambda: done(result))),
            lambda error: self._later(lambda: self._end(job, lambda: self._failed(error))),
            holds,
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


Request = TypeVar("Request")
Answer = TypeVar("Answer")


class LatestWins(Generic[Request, Answer]):
    """Runs `compute(request)` in a shared pool, one at a time; a newer request replaces one that still waits.

    Answers and failures are handed to the callbacks in the order of their requests, in a pool thread.
    """

    def __init__(
        self,
        pool: Executor,
        compute: Callable[[Request], Answer],
        done: Callable[[Request, Answer], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._pool = pool
        self._compute = compute
        self._done = done
        self._failed = failed
        self._lock = threading.Lock()
        self._waiting: list[Request] = []  # empty or one
        self._running = False
        self._closed = False

    def submit(self, request: Request) -> None:
        """Compute this request next; it replaces a waiting one."""
        with self._lock:
            if self._closed:
                return
            self._waiting = [request]
            if self._running:
                return
            self._running = True
        self._pool.submit(self._run)

    def close(self) -> None:
        """Drop the waiting request and the answer of the running one."""
        with self._lock:
            self._closed = True
            self._waiting = []

    @property
    def busy(self) -> bool:
        """Whether a request runs or waits."""
        return self._running

    def _run(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._running = False
                    return
                request = self._waiting.pop()
            try:
                answer = self._compute(request)
                if not self._closed:
                    self._done(request, answer)
            except Exception as error:  # noqa: BLE001 (whoever asked hears of any)
                if not self._closed:
                    self._failed(error)


class SharedWork(Generic[Request, Answer]):
    """`compute(request)`, not done again for one of the latest keys. From any thread.

    Who asks for what is being computed waits for it. A failure is everybody's who waited, and is not kept.
    """

    def __init__(
        self, compute: Callable[[Request], Answer], key: Callable[[Request], Hashable], *, kept: int = 8
    ) -> None:
        self._compute, self._key, self._kept = compute, key, kept
        self._lock = threading.Lock()
        self._answers: OrderedDict[Hashable, Future[Answer]] = OrderedDict()

    def __call__(self, request: Request) -> Answer:
        """The answer, which must not be changed."""
        key, mine = self._key(request), Future[Answer]()
        with self._lock:
            known = self._answers.setdefault(key, mine)
            while len(self._answers) > self._kept:
                self._answers.popitem(last=False)
        if known is mine:
            self._work_out(request, key, mine)
        return known.result()

    def _work_out(self, request: Request, key: Hashable, mine: Future[Answer]) -> None:
        try:
            mine.set_result(self._compute(request))
        except Exception as error:  # noqa: BLE001 (all who wait hear of any)
            with self._lock:
                if self._answers.get(key) is mine:
                    del self._answers[key]
            mine.set_exception(error)
