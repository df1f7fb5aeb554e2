"""Estimate of a sensor's delay from detected balls, without truth: a slower sensor has later trailing edges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from core.detection.refined.detector import RefinedDetection

OF_STRETCH: Final = (1.09, -0.135)
"""Delay [ms] as a function of the median edge latency [ms]: a line through 43 recordings of drawn scenes with 22
sensors, whose delays are 0.08 to 0.88 ms."""
LEFT_US: Final = 75
"""Standard deviation of the delays about that line. Within a flight the stretch changes with the light on the ball, so
this is for the median of whole flights."""
FEWEST: Final = 200
MIN_PX_PER_MS: Final = 1.0
"""Slowest ball that is used."""


class DelayEstimate(NamedTuple):
    """An estimate for `refined.delay_us`."""

    delay_us: int
    sigma_us: int


def estimate_delay(detections: Sequence[RefinedDetection]) -> DelayEstimate | None:
    """Delay of the sensor that detected these balls; None if too few of them moved."""
    telling = [one.stretch_ms for one in detections if math.hypot(*one.velocity_px_per_ms) >= MIN_PX_PER_MS]
    if len(telling) < FEWEST:
        return None
    slope, start = OF_STRETCH
    return DelayEstimate(round(1000 * max(0.0, slope * float(np.median(telling)) + start)), LEFT_US)
