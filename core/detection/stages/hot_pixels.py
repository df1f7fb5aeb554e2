"""Optional stage: drop the events of pixels that fire continuously.

A defective pixel fires at a steady high rate; the edge of a ball passes a pixel within a few milliseconds. Time is cut
into ticks; a pixel's score goes up by one for a tick in which it fired and down by one for a tick in which it was
silent, so only a pixel that fires in more than half of its ticks can climb to the limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.events import Events, SensorSize
from core.jit import njit


@dataclass(frozen=True, slots=True, kw_only=True)
class HotPixelConfig:
    """When a pixel counts as defective."""

    enabled: bool = False
    """Drop the events of pixels that never stop firing. Off in the paper."""
    tick_ms: float = setting(4.0, 0.5, 20.0, step=0.5)
    """A pixel is suspected when it fires in more than half of the ticks: 4 ms catches about 175 events per second."""
    persistence_ms: float = setting(60.0, 10.0, 1000.0, step=10.0)
    """How long it must have fired like that. The slowest ball edge (0.2 px/ms) passes a pixel in less than 20 ms."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class HotPixelMemory:
    """State of each pixel, (height, width) each."""

    last_tick: NDArray[np.int64]
    score: NDArray[np.int32]

    @staticmethod
    def blank(sensor: SensorSize) -> HotPixelMemory:
        """Empty state."""
        shape = (sensor.height_px, sensor.width_px)
        # Long ago, but not so long that a difference to it would overflow.
        return HotPixelMemory(np.full(shape, np.iinfo(np.int32).min, np.int64), np.zeros(shape, np.int32))

    def copy(self) -> HotPixelMemory:
        """A deep copy."""
        return HotPixelMemory(self.last_tick.copy(), self.score.copy())


def keep_cool_pixels(events: Events, memory: HotPixelMemory, config: HotPixelConfig) -> NDArray[np.bool_]:
    """(N,) True for events of pixels that are not hot. `memory` is brought up to date in place."""
    limit = max(2, round(config.persistence_ms / config.tick_ms))
    tick_us = round(config.tick_ms * 1000)
    return _keep(events.t_us, events.x_px, events.y_px, memory.last_tick, memory.score, tick_us, limit)


@njit
def _keep(t_us, x_px, y_px, last_tick, score, tick_us, limit):
    keep = np.empty(len(t_us), np.bool_)
    for i in range(len(t_us)):
        x, y = x_px[i], y_px[i]
        tick = t_us[i] // tick_us
        if tick > last_tick[y, x]:
            silent = tick - last_tick[y, x] - 1
            risen = max(0, score[y, x] - silent) + 1
            score[y, x] = min(risen, 2 * limit)  # capped, so that a pixel that recovers is trusted again
            last_tick[y, x] = tick
        keep[i] = score[y, x] < limit
    return keep
