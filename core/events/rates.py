"""Event rates over time, from the per-millisecond counts that a recording's index holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class RateCurve:
    """Mean event rate in N consecutive bins."""

    t_s: NDArray[np.float64]
    """(N,) middle of each bin."""
    rate_hz: NDArray[np.float64]
    """(N,) events per second."""


def rate_curve(counts_per_ms: NDArray[np.int64], *, bins: int) -> RateCurve:
    """The rate over a whole recording in at most `bins` bins of whole milliseconds; the last bin may be shorter."""
    if not len(counts_per_ms):
        return RateCurve(np.zeros(0), np.zeros(0))
    width_ms = max(1, -(-len(counts_per_ms) // bins))
    starts_ms = np.arange(0, len(counts_per_ms), width_ms)
    ends_ms = np.minimum(starts_ms + width_ms, len(counts_per_ms))
    sums = np.add.reduceat(counts_per_ms, starts_ms)
    return RateCurve((starts_ms + ends_ms) / 2e3, sums * 1e3 / (ends_ms - starts_ms))
