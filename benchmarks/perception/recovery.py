"""How soon a ball that appears, or comes back, is found."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.metrics.run import WindowAnswers
from core.metrics.score import MATCH_RADIUS_PX
from core.recordings import PixelTruth

AWAY_US: Final = 5000
"""A ball that could not be seen for so long has to be found again."""
STAYS_US: Final = 10_000
"""Shorter sights of a ball are not counted."""


def recovery_times_ms(answers: WindowAnswers, truth: PixelTruth) -> list[float | None]:
    """From each appearance of the ball to the end of the first window with a right answer; None if it went without."""
    there = truth.at(answers.t_us)
    off_px = np.hypot(answers.u_px - there.u_px, answers.v_px - there.v_px)
    right = answers.detected & there.visible & (np.nan_to_num(off_px, nan=np.inf) <= MATCH_RADIUS_PX)
    times: list[float | None] = []
    for start_us, end_us in appearances(truth):
        ends = answers.end_us[right & (answers.t_us >= start_us) & (answers.t_us <= end_us)]
        times.append(float(ends.min() - start_us) / 1000 if len(ends) else None)
    return times


def appearances(truth: PixelTruth) -> list[tuple[int, int]]:
    """First and last time of each sight of the ball that began after it had been away."""
    edges: NDArray[np.intp] = np.flatnonzero(np.diff(np.concatenate([[False], truth.visible, [False]]).astype(np.int8)))
    found: list[tuple[int, int]] = []
    last_us = int(truth.t_us[0]) if len(truth.t_us) else 0
    for first, after in edges.reshape(-1, 2).tolist():
        start_us, end_us = int(truth.t_us[first]), int(truth.t_us[after - 1])
        if start_us - last_us >= AWAY_US and end_us - start_us >= STAYS_US:
            found.append((start_us, end_us))
        last_us = end_us
    return found
