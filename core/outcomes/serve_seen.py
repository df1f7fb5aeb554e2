"""Time and speed of a serve when it was first seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.outcomes.ball_log import BallPoints
from core.table import GRAVITY_MPS2

Array = NDArray[np.float64]
SPAN_S: Final = 0.060
"""Duration of the first points used (choice): before the bounce, and long enough for an error of some cm/s."""
FEWEST: Final = 5
SLOWEST_MPS: Final = 1.0
"""Slowest speed of a serve towards the robot (choice)."""


@dataclass(frozen=True, slots=True, eq=False)
class ServeSeen:
    """An observed serve."""

    t_us: int
    """Time of its first point: the ball was served then or just before."""
    p_world_m: Array
    """(3,) there."""
    v_world_mps: Array
    """(3,) there."""
    sigma_mps: float
    """Standard deviation of the speed, from the scatter of the points about the fitted flight."""

    @property
    def speed_mps(self) -> float:
        """Speed when it was first seen, m/s."""
        return float(np.linalg.norm(self.v_world_mps))


def see_serve(points: BallPoints) -> ServeSeen | None:
    """Serve from its first points; None without enough of them, or if the ball does not come towards the robot."""
    first = points.part(points.t_s <= SPAN_S)
    if len(first) < FEWEST or first.t_s[-1] < SPAN_S / 3:
        return None
    fit = _free_fall(first.t_s, first.ps_m)
    spread = fit.residuals_m
    right = np.linalg.norm(spread, axis=1) <= 3 * max(1.5 * float(np.median(np.linalg.norm(spread, axis=1))), 5e-4)
    if FEWEST <= right.sum() < len(right):
        fit = _free_fall(first.t_s[right], first.ps_m[right])
    if fit.v_mps[0] > -SLOWEST_MPS:
        return None
    scatter = float(np.sqrt((fit.residuals_m**2).mean())) + 2e-4
    t = first.t_s[right] if right.sum() >= FEWEST else first.t_s
    sigma = scatter / max(float(np.sqrt(((t - t.mean()) ** 2).sum())), 1e-6)
    return ServeSeen(points.start_us, fit.p_m, fit.v_mps, sigma)


@dataclass(frozen=True, slots=True, eq=False)
class _FreeFall:
    p_m: Array
    v_mps: Array
    residuals_m: Array


def _free_fall(t_s: Array, ps_m: Array) -> _FreeFall:
    """Fit of free fall to points (K, 3): state at time zero."""
    lifted = ps_m.copy()
    lifted[:, 2] += 0.5 * GRAVITY_MPS2 * t_s**2
    design = np.column_stack([np.ones(len(t_s)), t_s])
    found = np.linalg.lstsq(design, lifted, rcond=None)[0]
    return _FreeFall(found[0], found[1], lifted - design @ found)
