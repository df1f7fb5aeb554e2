"""A clock that begins again at 0, put right: one odd time does not count as such a beginning."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray


class RunningClock:
    """Unwraps the times of a counter, part after part."""

    def __init__(self, length: int) -> None:
        """`length` is the value at which the counter begins again at 0."""
        self._length = length
        self._usual: int | None = None
        self.wraps = 0
        """How often the counter has begun again."""

    def unwrap(self, t: NDArray[np.int64]) -> NDArray[np.int64]:
        """The times as if the counter had more bits.

        The median of five neighbours tells where it began again; each time gets the epoch that brings it next to them.
        """
        if not len(t):
            return t
        usual = np.median(sliding_window_view(np.pad(t, 2, mode="edge"), 5), axis=1).astype(np.int64)
        before = usual[0] if self._usual is None else self._usual % self._length
        epoch = 0 if self._usual is None else self._usual - before
        steps = np.diff(usual, prepend=before)
        half = self._length // 2
        wraps = np.cumsum((steps < -half).astype(np.int64) - (steps > half))
        self.wraps += max(0, int(wraps[-1]))
        usual += epoch + self._length * wraps
        self._usual = int(usual[-1])
        return t + self._length * np.rint((usual - t) / self._length).astype(np.int64)
