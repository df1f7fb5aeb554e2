"""How fast the ball was along its trail."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HALF_WINDOW_US: Final = 16_000
"""A speed is the way from so long before a point to so long after it: an error of 1 mm at its ends is 0.05 m/s."""


def trail_speeds_mps(t_us: NDArray[np.int64], ps_world_m: Array) -> Array:
    """(N,) speed at each of the points (N, 3) of one flight, seen at ascending times (N,); NaN for a single point.

    It is that of the chord, so a little low over the milliseconds of a bounce.
    """
    if len(t_us) < 2:
        return np.full(len(t_us), np.nan)
    first = np.searchsorted(t_us, t_us - HALF_WINDOW_US, side="left")
    last = np.searchsorted(t_us, t_us + HALF_WINDOW_US, side="right") - 1
    alone = first == last  # a gap on both sides: then from the neighbour
    first, last = np.where(alone, np.maximum(first - 1, 0), first), np.where(alone & (first == 0), last + 1, last)
    seconds = (t_us[last] - t_us[first]) * 1e-6
    return np.linalg.norm(ps_world_m[last] - ps_world_m[first], axis=1) / seconds
