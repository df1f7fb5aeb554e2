"""Control of a task: it reports its progress, and can be stopped; and one thread per worker process, also for torch,
because every core has its process already.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, Protocol

from threadpoolctl import threadpool_limits


class TasksStoppedError(Exception):
    """The task was cancelled."""


class TaskLostError(Exception):
    """All processes that worked on a task died, up to the allowed number."""


class TaskControl(Protocol):
    """Called by a task, from time to time, with its progress."""

    def __call__(self, share: float) -> None:
        """The share of the piece that is done, 0..1.

        Raises:
            TasksStoppedError: if nobody wants it any more; what it has begun to write is to be taken away.
        """
        ...

    def stopped(self) -> bool:
        """Whether it was cancelled; for tasks that poll."""
        ...


class CallbackControl:
    """Control of a task that runs in this process."""

    def __init__(self, tell: Callable[[float], None], stopped: Callable[[], bool]) -> None:
        self._tell = tell
        self.stopped = stopped

    def __call__(self, share: float) -> None:
        """Report the progress, unless it is cancelled."""
        if self.stopped():
            raise TasksStoppedError
        self._tell(share)


VARIABLES: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""Read by libraries when they are loaded."""


@functools.cache
def use_one_thread() -> None:
    """Limit BLAS, OpenMP, torch and numba to one thread in this process, loaded already or later."""
    os.environ.update(dict.fromkeys(VARIABLES, "1"))
    if "numba" not in sys.modules:
        os.environ["NUMBA_NUM_THREADS"] = "1"
    else:
        sys.modules["numba"].set_num_threads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    threadpool_limits(1)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Context in which torch computes in the calling thread: a fixed order of sums, and all its time is counted.

    Where nobody has loaded torch, as with an agent of numpy alone, the same for numpy.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        with threadpool_limits(1):
            yield
        return
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
