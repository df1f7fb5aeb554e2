"""The index by milliseconds: the first event of each one, as DSEC keeps it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class MsIndex:
    """Grows with a sorted stream of times; `marks()[k]` is the first event with t >= k ms."""

    def __init__(self) -> None:
        self._marks = np.empty(1024, np.uint64)
        self._filled = 0
        self._events = 0

    def extend(self, t_us: NDArray[np.int64]) -> None:
        """Count the next events of the stream; their times are not below the earlier ones."""
        if not len(t_us):
            return
        needed = int(t_us[-1]) // 1000 + 1
        if needed > len(self._marks):
            grown = np.empty(max(needed, 2 * len(self._marks)), np.uint64)
            grown[: self._filled] = self._marks[: self._filled]
            self._marks = grown
        if needed > self._filled:
            edges = np.arange(self._filled, needed, dtype=np.int64) * 1000
            self._marks[self._filled : needed] = np.searchsorted(t_us, edges) + self._events
            self._filled = needed
        self._events += len(t_us)

    def marks(self) -> NDArray[np.uint64]:
        """One entry for every millisecond up to that of the last event."""
        return self._marks[: self._filled]
