"""Control of a task: it reports its progress, and is told to stop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


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
