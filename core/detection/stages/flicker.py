"""Optional stage: drop the events of pixels that flicker at the frequency of the lighting.

Lamps on the mains brighten and darken 100 or 120 times a second. A pixel that sees one rises (first ON after an OFF)
once a period; several rises in a row at such a spacing are flicker, a passing ball gives one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.errors import ConfigError
from core.events import Events, SensorSize
from core.jit import njit


@dataclass(frozen=True, slots=True, kw_only=True)
class FlickerConfig:
    """Frequencies that count as flicker."""

    enabled: bool = False
    """Drop the events of pixels that flicker with the lighting. Off in the paper."""
    frequency_min_hz: float = setting(80.0, 10.0, 500.0, step=5.0)
    """Lowest frequency: 50 Hz mains give 100 Hz, 60 Hz mains 120 Hz."""
    frequency_max_hz: float = setting(260.0, 20.0, 2000.0, step=10.0)
    """Highest frequency; above twice the mains' own because many lamps show the first harmonic."""
    cycles_min: int = setting(3, 1, 20)
    """Periods in a row before a pixel's events are dropped."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.frequency_max_hz <= self.frequency_min_hz:
            raise ConfigError(
                "no rhythm is allowed",
                expected=f"frequency_max_hz above {self.frequency_min_hz:g}",
                got=self.frequency_max_hz,
                where="FlickerConfig.frequency_max_hz",
            )


class FlickerMemory(NamedTuple):
    """State of each pixel, (height, width) each."""

    risen_us: NDArray[np.int64]
    """Time of the last rise."""
    was_on: NDArray[np.bool_]
    cycles: NDArray[np.int32]
    """Consecutive periods in range."""

    @staticmethod
    def blank(sensor: SensorSize) -> FlickerMemory:
        """Empty state."""
        shape = (sensor.height_px, sensor.width_px)
        long_ago = np.full(shape, np.iinfo(np.int64).min // 2, np.int64)
        return FlickerMemory(long_ago, np.zeros(shape, np.bool_), np.zeros(shape, np.int32))

    def copy(self) -> FlickerMemory:
        """A deep copy."""
        return FlickerMemory(self.risen_us.copy(), self.was_on.copy(), self.cycles.copy())


def keep_steady_pixels(events: Events, memory: FlickerMemory, config: FlickerConfig) -> NDArray[np.bool_]:
    """(N,) True for events of pixels that do not flicker. `memory` is brought up to date in place."""
    shortest_us = int(1e6 / config.frequency_max_hz)
    longest_us = int(1e6 / config.frequency_min_hz)
    columns = events.t_us, events.x_px, events.y_px, events.on
    return _keep(*columns, memory, shortest_us, longest_us, config.cycles_min)


@njit
def _keep(t_us, x_px, y_px, on, memory, shortest_us, longest_us, cycles_min):
    risen_us, was_on, cycles = memory
    keep = np.empty(len(t_us), np.bool_)
    for i in range(len(t_us)):
        x, y = x_px[i], y_px[i]
        since = t_us[i] - risen_us[y, x]
        if since > longest_us:
            cycles[y, x] = 0
        if on[i] and not was_on[y, x]:
            if shortest_us <= since <= longest_us:
                cycles[y, x] += 1
            else:
                cycles[y, x] = 0
            risen_us[y, x] = t_us[i]
        was_on[y, x] = on[i]
        keep[i] = cycles[y, x] < cycles_min
    return keep
