"""The split of a recording in time: blocks that are tuned on, and blocks that are held out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError

MIN_TIMES: Final = 8
"""Fewest positions of the ball for tuning and checking."""
DRAW: Final = 109
"""The draw that mixes best what comes back every two to seven blocks, of 10, 20 and 40: each part of such a period has
at least a fifth of its blocks on either side."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeBlocks:
    """Consecutive blocks; all of time belongs to one of them.

    One block of each pair of neighbours is held out; which of them was drawn once for good. Every other block would put
    the first half of each serve on one side wherever serves come at a steady pace.
    """

    starts_us: NDArray[np.int64]
    """(B,) ascending; the first block also has what is before it."""
    gaps_us: NDArray[np.int64]
    """(B,) left out at the beginning of each."""

    def tuned(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(N,) whether times (N,) are tuned on."""
        return self._kept(t_us) & ~self._in_held_out(t_us)

    def held_out(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(N,) whether times (N,) are held out."""
        return self._kept(t_us) & self._in_held_out(t_us)

    def _blocks(self, t_us: NDArray[np.int64]) -> NDArray[np.intp]:
        return np.maximum(np.searchsorted(self.starts_us, t_us, side="right") - 1, 0)

    def _kept(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        block = self._blocks(t_us)
        since_us = t_us - self.starts_us[block]
        return (since_us < 0) | (since_us >= self.gaps_us[block])

    def _in_held_out(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        pairs = np.tile([False, True], (len(self.starts_us) // 2 + 1, 1))
        return np.random.default_rng(DRAW).permuted(pairs, axis=1).ravel()[self._blocks(t_us)]


def cut_blocks(ball_us: NDArray[np.int64], count: int, gap_us: int) -> TimeBlocks:
    """Blocks with equally many of the times at which a ball is known: fewer than `count` where those are few.

    Raises:
        RecordingError: if there are not enough of them.
    """
    times = np.unique(ball_us)
    if len(times) < MIN_TIMES:
        remedy = "label more of it, or take another recording"
        raise RecordingError("too few ball positions", expected=f"{MIN_TIMES} or more", got=len(times), remedy=remedy)
    count = max(2, min(count, len(times) // (MIN_TIMES // 2)))
    starts = times[np.arange(count) * len(times) // count]
    lengths = np.diff(np.append(starts, times[-1] + 1))
    gaps = np.minimum(gap_us, lengths // 3)
    gaps[0] = 0
    return TimeBlocks(starts, gaps)
