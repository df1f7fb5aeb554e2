"""The one delay of sensor and method together, which is taken out of every method alike before errors are compared.

Answers are stamped by each method in its own way: `refined` at the end of its window less the sensor's delay, `paper`
at the end of its window. A ball at 3 px/ms is then 0.6 px off by nothing but the stamp. A robot takes such a constant
out by calibration; here the truth of the recording says what it is.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from core.events import SensorSize
from core.metrics.grid_score import GRID_US, LAG_FROM_PX_PER_MS, errors_without_lag, score_on_grid
from core.metrics.run import WindowAnswers
from core.recordings import PixelTruth

ANY_SPEED: Final = (0.0, math.inf)
"""Speeds of the ball in the picture that count, px/ms: all."""


LONGEST_US: Final = 5000
"""No sensor with a method is later, or earlier, than this (pixels of 150 Hz in a dark room: 2.5 ms)."""
COARSE_US: Final = 50
FINE_US: Final = 5
"""At 4 px/ms 0.02 px."""


def find_delay_us(answers: WindowAnswers, truth: PixelTruth, sensor: SensorSize) -> int:
    """The delay without which the median error of the right answers of one camera is least, us; negative for answers
    that are ahead of the ball.

    The least error and not the median lag, which a slow ball decides as much as a fast one: what is taken out then
    makes no method worse. 0 where no ball moves fast enough to tell.
    """
    score = score_on_grid(answers, truth, sensor, ANY_SPEED, window_us=GRID_US)
    if not (score.speed_px_per_ms >= LAG_FROM_PX_PER_MS).any():
        return 0

    def least(delays_us: range) -> int:
        # Of equal ones that nearest to none.
        return min(delays_us, key=lambda us: (float(np.median(errors_without_lag(score, 1e-3 * us))), abs(us)))

    near_us = least(range(-LONGEST_US, LONGEST_US + 1, COARSE_US))
    return least(range(near_us - COARSE_US, near_us + COARSE_US + 1, FINE_US))


def without_delay(answers: WindowAnswers, delay_us: int) -> WindowAnswers:
    """The same answers, each about a moment that much earlier."""
    return replace(answers, t_us=answers.t_us - delay_us)
