"""Work for one browser off the loop, where only the newest request matters."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Generic, TypeVar

logger = logging.getLogger(__name__)
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
