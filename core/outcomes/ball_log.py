"""The points of one ball, in order of time, as columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MAX_POINTS = 4000
"""Most points of one ball, so that a ball at rest does not fill the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class BallPoints:
    """(K,) points; times in seconds since `start_us`, so that microseconds keep their digits."""

    start_us: int
    t_s: Array
    ps_m: Array
    """(K, 3)."""
    covariances_m2: Array
    """(K, 3, 3)."""

    def __len__(self) -> int:
        return len(self.t_s)

    def part(self, which: slice | NDArray[np.bool_] | NDArray[np.intp]) -> BallPoints:
        """Selected points."""
        return BallPoints(self.start_us, self.t_s[which], self.ps_m[which], self.covariances_m2[which])


class BallLog:
    """Filled point by point."""

    def __init__(self) -> None:
        self._t_us = np.empty(MAX_POINTS, np.int64)
        self._ps = np.empty((MAX_POINTS, 3))
        self._covariances = np.empty((MAX_POINTS, 3, 3))
        self._count = 0

    def clear(self) -> None:
        """Forget the ball."""
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def last_us(self) -> int | None:
        """Time of the newest point; None without one."""
        return int(self._t_us[self._count - 1]) if self._count else None

    def add(self, t_us: int, p_m: Array, covariance_m2: Array) -> bool:
        """Add a point; False for one that is not later than the last, not finite, or too many."""
        n = self._count
        if n == MAX_POINTS or (n and t_us <= self._t_us[n - 1]) or not np.isfinite(p_m).all():
            return False
        self._t_us[n], self._ps[n], self._covariances[n] = t_us, p_m, covariance_m2
        self._count = n + 1
        return True

    def keep_last(self, count: int) -> None:
        """Forget all but the newest points."""
        for column in (self._t_us, self._ps, self._covariances):
            column[:count] = column[self._count - count : self._count].copy()
        self._count = count

    def points(self) -> BallPoints:
        """All points so far; valid until the next one is added."""
        n = self._count
        start_us = int(self._t_us[0]) if n else 0
        t_s = np.asarray((self._t_us[:n] - start_us) * 1e-6, np.float64)
        return BallPoints(start_us, t_s, self._ps[:n], self._covariances[:n])
