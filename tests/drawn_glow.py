"""Events of drawn light, whose place is exact: of a ball without a rim, or of whatever else shines."""

import math
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from core.events import Events, SensorSize

SENSOR = SensorSize(160, 120)
DURATION_US = 120_000


def glow_centre(t_us: float) -> tuple[float, float]:
    """It swings through 60 px and back."""
    return 80.0 + 30.0 * math.sin(2e-6 * math.pi * 8.0 * t_us), 60.0 + 1e-4 * t_us


def draw_glow(bright: bool) -> Events:
    """Events of a Gaussian glow, 12 px wide at one sigma: each pixel fires at every 0.25 of log light."""
    rows, columns = np.mgrid[: SENSOR.height_px, : SENSOR.width_px]

    def light(t_us: int) -> NDArray:
        u, v = glow_centre(t_us)
        return (1.0 if bright else -1.0) * 3.0 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2.0 * 12.0**2))

    return events_of_light(light, range(0, DURATION_US, 200), SENSOR, seed=3)


def events_of_light(light: Callable[[int], NDArray], times_us: Iterable[int], sensor: SensorSize, seed: int) -> Events:
    """Events of pixels that fire at every 0.25 of log light (height, width), looked at at these times."""
    level = np.random.default_rng(seed).uniform(
        0.0, 1.0, (sensor.height_px, sensor.width_px)
    )  # where each is between two thresholds
    found, before = [], None
    for t_us in times_us:
        now = np.floor(light(t_us) / 0.25 + level)
        if before is not None:
            y, x = np.nonzero(now != before)
            found.append(np.column_stack([np.full(len(x), t_us), x, y, now[y, x] > before[y, x]]))
        before = now
    t, x, y, on = np.concatenate(found).T
    return Events.from_columns(t, x, y, on.astype(bool), sensor)
