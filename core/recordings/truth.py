"""Ground truth of the ball over time: in the world and in the picture of one camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, slots=True, eq=False)
class BallTruth:
    """N samples of the ball in the world, t_us ascending."""

    t_us: NDArray[np.int64]
    p_world_m: NDArray[np.float64]
    """(N, 3)"""
    v_world_mps: NDArray[np.float64]
    """(N, 3)"""
    spin_radps: NDArray[np.float64]
    """(N, 3), world axes."""
    visible: NDArray[np.bool_]
    """False where there is no ball in play."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelTruth:
    """N samples of the ball's outline in one camera, t_us ascending; nan where it is not visible."""

    t_us: NDArray[np.int64]
    u_px: NDArray[np.float64]
    v_px: NDArray[np.float64]
    r_px: NDArray[np.float64]
    visible: NDArray[np.bool_]
    """The centre lies on the sensor and nothing hides it."""

    def at(self, t_us: ArrayLike) -> PixelTruth:
        """The truth at other times, linear between samples; not visible outside them or beside an invisible one."""
        t = np.atleast_1d(np.asarray(t_us, np.int64))
        if not len(self.t_us):
            nothing = np.full(len(t), np.nan)
            return PixelTruth(t, nothing, nothing, nothing, np.zeros(len(t), np.bool_))
        after = np.clip(np.searchsorted(self.t_us, t, side="left"), 0, len(self.t_us) - 1)
        before = np.where(self.t_us[after] == t, after, np.maximum(after - 1, 0))
        inside = (self.t_us[0] <= t) & (t <= self.t_us[-1])
        visible = inside & self.visible[before] & self.visible[after]
        span = self.t_us[after] - self.t_us[before]
        weight = np.where(span > 0, (t - self.t_us[before]) / np.maximum(span, 1), 0.0)
        u, v, r = (
            np.where(visible, column[before] * (1 - weight) + column[after] * weight, np.nan)
            for column in (self.u_px, self.v_px, self.r_px)
        )
        return PixelTruth(t, u, v, r, visible)
