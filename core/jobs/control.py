"""What a piece of work is given beside itself: somebody to tell how far it is, and who says when nobody wants it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class TasksStoppedError(Exception):
    """Nobody wants the answer any more."""


class TaskLostError(Exception):
    """Every process that worked on a piece died, as often as one may."""


class TaskControl(Protocol):
    """Told by a piece, from time to time, how far it is."""

    def __call__(self, share: float) -> None:
        """The share of the piece that is done, 0..1.

        Raises:
            TasksStoppedError: if nobody wants it any more; what it has begun to write is to be taken away.
        """
        ...

    def stopped(self) -> bool:
        """Whether nobody wants it any more; for work that asks instead."""
        ...


class CallbackControl:
    """Control of a task that runs in this process."""

    def __init__(self, tell: Callable[[float], None], stopped: Callable[[], bool]) -> None:
        self._tell = tell
        self.stopped = stopped

    def __call__(self, share: float) -> None:
        """Tell it, unless it is to stop."""
        if self.stopped():
            raise TasksStoppedError
        self._tell(share)
