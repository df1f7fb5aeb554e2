"""Processes of this machine as a `concurrent.futures` executor that outlives the death of any of them.

Each process is a pool of its own, so that it is known which piece a process that died was working on; that piece is
tried again in a new one, and the others hear nothing of it.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final, TypeVar

from core.files import end_with_parent
from core.jobs.control import CallbackControl, TaskControl, TaskLostError, use_one_thread
from core.registry import load_plugin_files

logger = logging.getLogger(__name__)

R = TypeVar("R")
TRIES: Final = 3
"""Attempts at a task whose process was killed or ran out of memory."""


class LocalExecutor(Executor):
    """A number of processes, each running one task at a time; started on first use."""

    blames_one: Final = True

    def __init__(self, processes: int) -> None:
        self._slots = [_Slot() for _ in range(processes)]
        self._free: SimpleQueue[_Slot] = SimpleQueue()
        for slot in self._slots:
            self._free.put(slot)
        self._threads = ThreadPoolExecutor(processes, thread_name_prefix="piece")

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Call `fn(*args, control)` in one of the processes, where `control` is a `TaskControl`.

        The future raises TaskLostError if as many processes as `TRIES` have died over it.
        """
        return self._threads.submit(self._run, fn, *args, **kwargs)

    def shares(self) -> float:
        """Sum of the progress, 0 to 1 each, of the running tasks."""
        return sum(slot.share.value for slot in self._slots)

    def check(self) -> None:
        """Do nothing: a process that died is replaced."""

    def is_lost(self, error: BaseException) -> bool:
        """Whether a task failed because its processes died."""
        return isinstance(error, TaskLostError)

    def check_file(self, path: Path) -> None:
        """Do nothing: all processes of a machine see the same files."""

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Shut down. With `cancel_futures` the processes are killed."""
        if cancel_futures:
            for slot in self._slots:
                slot.kill()
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        for slot in self._slots:
            slot.end(wait=wait)

    def _run(self, fn: Callable[..., R], *args: Any, **kwargs: Any) -> R:
        slot = self._free.get()
        try:
            for attempt in range(1, TRIES + 1):
                try:
                    return slot.submit(fn, *args, **kwargs).result()
                except (BrokenProcessPool, MemoryError):
                    if slot.killed:
                        raise CancelledError from None
                    if attempt < TRIES:
                        logger.warning(
                            "a process died at its work, which is tried again (%d of %d)", attempt + 1, TRIES
                        )
            raise TaskLostError
        finally:
            slot.share.value = 0.0
            self._free.put(slot)


class _Slot:
    """Slot of one process and its replacements."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("spawn")  # a fork would copy the threads' locks
        self.share = self._context.Value("d", 0.0, lock=False)
        self.killed = False
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None

    def submit(self, fn: Callable[..., R], *args: Any, **kwargs: Any) -> Future[R]:
        with self._lock:  # `kill` knows a process that is just starting
            if self.killed:
                raise CancelledError
            if self._pool is not None:
                with suppress(BrokenProcessPool):
                    return self._pool.submit(_work, fn, *args, **kwargs)
                self._pool.shutdown(wait=True)
            self._pool = ProcessPoolExecutor(
                1, mp_context=self._context, initializer=_start_process, initargs=(self.share,)
            )
            return self._pool.submit(_work, fn, *args, **kwargs)

    def kill(self) -> None:
        """Kill at once: a hanging or stopped process ignores other signals."""
        with self._lock:
            self.killed = True
            processes = {} if self._pool is None else self._pool._processes  # as `kill_workers` of Python 3.14 does
            for process in list((processes or {}).values()):
                process.kill()

    def end(self, *, wait: bool) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=wait, cancel_futures=True)


_control: TaskControl | None = None
"""Control of the task in this worker process; it reports the progress to the parent."""


def _start_process(share: Any) -> None:
    """Initialise a process: it ignores Ctrl-C, and ends with its parent, even in the middle of a task."""
    global _control

    def tell(value: float) -> None:
        share.value = value

    _control = CallbackControl(tell, lambda: False)  # a cancelled task is killed
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    use_one_thread()
    load_plugin_files()  # a task may contain objects of a plugin and is unpickled after this


def _work(fn: Callable[..., R], *args: Any, **kwargs: Any) -> R:
    assert _control is not None
    return fn(*args, _control, **kwargs)
