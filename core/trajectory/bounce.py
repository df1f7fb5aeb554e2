"""Noticing a bounce in a stream of heights: the vertical velocity changes its sign near the table."""

from __future__ import annotations

import math

from core.trajectory.config import PaperPredictorConfig

CONFIRM = 2
"""Points in a row that must have risen: one may be an outlier."""


class BounceFinder:
    """Watches the height fall to a lowest point near the table and rise again."""

    def __init__(self, config: PaperPredictorConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Forget every point seen so far."""
        self._high_m = -math.inf
        self._low_m = math.inf
        self._low_t_us = 0
        self._fallen = False
        self._risen = 0

    def add(self, t_us: int, z_m: float) -> int | None:
        """The time of the lowest point once the ball has bounced there, else None. Finds one bounce after the other."""
        rise = self._config.bounce_rise_m
        if z_m <= self._low_m:
            self._low_m, self._low_t_us = z_m, t_us
        if not self._fallen:
            self._high_m = max(self._high_m, z_m)
            if z_m < self._high_m - rise:
                self._fallen, self._low_m, self._low_t_us = True, z_m, t_us
            return None
        self._risen = self._risen + 1 if z_m > self._low_m + rise else 0
        if self._risen < CONFIRM:
            return None
        bounced_us = self._low_t_us if self._low_m < self._config.bounce_height_m else None
        self.reset()
        self._high_m = self._low_m = z_m
        self._low_t_us = t_us
        return bounced_us
