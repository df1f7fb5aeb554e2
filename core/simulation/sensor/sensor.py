"""The event sensor: its settings, and the state of its pixels between one instant and the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting

LOWEST_THRESHOLD = 0.02
"""No pixel of a real sensor is more sensitive than a few per cent of contrast, whatever the mismatch draws."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorConfig:
    """A dynamic vision sensor. Contrast is the change of the natural logarithm of intensity."""

    on_threshold: float = setting(0.2, 0.05, 1.0)
    """Contrast that makes an ON event; 0.2 is a common bias of current sensors (nominal 20 to 25 %)."""
    off_threshold: float = setting(0.2, 0.05, 1.0)
    """Contrast that makes an OFF event."""
    threshold_mismatch: float = setting(0.075, 0.0, 0.5)
    """Standard deviation from pixel to pixel, as a share of the threshold; 0.015 / 0.2 of published pixels."""
    refractory_us: int = setting(60, 0, 2000)
    """A pixel that fired is held in reset this long and starts again from the intensity it then sees."""
    photoreceptor_us: float = setting(200.0, 0.0, 5000.0)
    """Time constant of the first-order photoreceptor: 200 us is 800 Hz, indoor light."""
    noise_hz: float = setting(0.1, 0.0, 20.0)
    """Background events per pixel and second, leak and shot together: 0.1 in good light, 1 to 5 in the dark."""
    leak_share: float = setting(0.3, 0.0, 1.0)
    """Share of the background that is junction leakage: ON events only. The rest is shot noise, ON as often as OFF."""
    hot_pixels_per_million: float = setting(15.0, 0.0, 1000.0)
    """Pixels that fire on their own."""
    hot_pixel_hz: float = setting(150.0, 0.0, 5000.0)
    """Median rate of a hot pixel; rates spread log-normally by a factor of e."""
    readout_mevps: float = setting(100.0, 0.1, 2000.0)
    """Events that the readout passes on per microsecond: a choice; data sheets are not to hand."""
    readout_limit_us: int = setting(1000, 0, 100_000)
    """An event that would wait longer for its readout is dropped."""

    def __post_init__(self) -> None:
        check_settings(self)


TARGET, RECEPTOR, REFERENCE, TIME_US, RELEASE_US, ON_THRESHOLD, OFF_THRESHOLD = range(7)
"""Columns of a pixel's state. One row is one cache line, since a kernel that touches a pixel needs all of it:
logarithm of the intensity it last saw; output of the photoreceptor, which follows that; output that the comparators
measure contrast from; the instant that this row describes (pixels at rest lag behind); end of the refractory period;
the two thresholds."""
LONG_AGO_US = -1e12
"""Before any event: no pixel is refractory at first."""


class PixelState(NamedTuple):
    """What every pixel of a sensor remembers; changed in place by the kernels of `core.simulation.sensor.pixels`."""

    rows: NDArray[np.float64]
    """(pixels, 8), row-major over the sensor."""
    last_event_us: NDArray[np.int64]
    """(pixels,) whole microsecond of the last event, noise included; apart, for noise reads it all over the sensor."""
    active: NDArray[np.bool_]
    """Listed in `active_list`: touched in this block, or still following."""
    active_list: NDArray[np.int64]
    """(pixels,) room for the indices of active pixels."""
    active_count: NDArray[np.int64]
    """(1,) how many are listed."""


def make_pixels(log_intensity: NDArray[np.floating], config: SensorConfig, rng: np.random.Generator) -> PixelState:
    """Pixels at rest that have looked at a static picture (pixels,) for long."""
    count = len(log_intensity)
    rows = np.zeros((count, 8))
    rows[:, (TARGET, RECEPTOR, REFERENCE)] = log_intensity[:, None]
    rows[:, RELEASE_US] = LONG_AGO_US
    for column, mean in ((ON_THRESHOLD, config.on_threshold), (OFF_THRESHOLD, config.off_threshold)):
        drawn = mean * (1.0 + config.threshold_mismatch * rng.standard_normal(count))
        rows[:, column] = np.maximum(drawn, LOWEST_THRESHOLD)
    last_event_us = np.full(count, int(LONG_AGO_US))
    return PixelState(rows, last_event_us, np.zeros(count, np.bool_), np.zeros(count, np.int64), np.zeros(1, np.int64))
