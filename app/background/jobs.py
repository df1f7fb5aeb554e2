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
        """Of the work that is done, 0..1."""
        self._thread = threading.Thread(target=self._run, name="rallyscope-job", daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """The thread has not ended."""
        return self._thread.is_alive()

    def cancel(self) -> None:
        """Ask it to stop; nothing is delivered any more."""
        self._cancel.set()

    def wait(self, timeout_s: float) -> bool:
        """Whether it ended within this time."""
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
