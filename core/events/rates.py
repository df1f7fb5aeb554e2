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


def rate_curve(counts_per_ms: NDArray[np.int64], duration_us: int, *, bins: int) -> RateCurve:
    """The rate over a whole recording in at most `bins` bins of whole milliseconds.

    The last millisecond may have begun only: the last bin is as long as the recording goes on, at least half as long as
    the others.
    """
    if not len(counts_per_ms):
        return RateCurve(np.zeros(0), np.zeros(0))
    width_ms = max(1, -(-len(counts_per_ms) // bins))
    starts_ms = np.arange(0, len(counts_per_ms), width_ms)
    end_ms = min(duration_us / 1e3, float(len(counts_per_ms)))
    if len(starts_ms) > 1 and end_ms - starts_ms[-1] < width_ms / 2:
        starts_ms = starts_ms[:-1]
    edges_ms = np.append(starts_ms.astype(np.float64), max(end_ms, starts_ms[-1] + width_ms / 2))
    sums = np.add.reduceat(counts_per_ms, starts_ms)
    return RateCurve((edges_ms[:-1] + edges_ms[1:]) / 2e3, sums * 1e3 / np.diff(edges_ms))
