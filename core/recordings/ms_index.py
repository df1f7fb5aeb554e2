"""The index by milliseconds: the first event of each one, as DSEC keeps it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError

MAX_TIME_US: Final = 24 * 3600 * 1_000_000
"""A recording is shorter than a day: a later time stamp is a damaged one, and the millisecond index stays in memory."""


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


def index_of(columns: Iterable[NDArray[np.int64]], where: object) -> NDArray[np.int64]:
    """The index of a stream of times, block by block.

    Raises:
        RecordingError: if a time is below an earlier one, or impossible.
    """
    index, last_us = MsIndex(), 0
    for t_us in columns:
        if len(t_us) and (int(t_us[0]) < last_us or bool((t_us[1:] < t_us[:-1]).any())):
            raise RecordingError("time runs backwards", where=where)
        if len(t_us) and int(t_us[-1]) >= MAX_TIME_US:
            raise RecordingError(
                "time stamp out of range", expected="under 24 hours", got=f"{t_us[-1]} us", where=where
            )
        index.extend(t_us)
        last_us = int(t_us[-1]) if len(t_us) else last_us
    return index.marks().astype(np.int64)


def index_agrees(marks: NDArray[np.int64], t_us: NDArray[np.int64], first: int) -> bool:
    """Whether an index (the number of all events behind its last entry) fits these events, the first of that number."""
    if not len(t_us):
        return True
    low, high = int(t_us[0]) // 1000, int(t_us[-1]) // 1000
    if low < 0 or high >= len(marks) - 1 or not marks[low] <= first < marks[low + 1]:
        return False
    begins = np.searchsorted(t_us, np.arange(low + 1, high + 1) * 1000)
    return bool(np.array_equal(marks[low + 1 : high + 1], begins + first))
