"""The paper's prediction for many simulated balls at once: five observed positions after the bounce -> p_c, v_c, t_c.

x and y move linearly, z falls with known gravity, so each axis has two unknowns that least squares finds. The ball is
observed on the simulator's time grid (10 ms); fast balls reach the racket before five observations, then the two or
more that there are count (choice).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.simulation.physics.episode import Arrivals, Serves
from core.simulation.physics.simulate import sample_serves
from core.simulation.physics.task import TaskConfig
from core.table import GRAVITY_MPS2

Array = NDArray[np.float64]

POINTS: Final = 5
FEWEST: Final = 2
"""Observations that determine two unknowns per axis."""


def predict_arrivals(serves: Serves, arrivals: Arrivals, step_s: float, config: TaskConfig) -> tuple[Array, Array]:
    """Predicted states (N, 6) at the hitting plane and times (N,) there; NaN with fewer than two observations."""
    first = np.floor(arrivals.bounce_t_s / step_s) + 1.0
    t_s: Array = (first[:, None] + np.arange(POINTS)) * step_s
    observed = t_s < arrivals.t_s[:, None]
    ps_m = sample_serves(serves, arrivals, np.where(observed, t_s, arrivals.bounce_t_s[:, None]), config)
    return extrapolate(t_s, ps_m, observed, config.stroke.hit_plane_x_m)


def extrapolate(t_s: Array, ps_m: Array, observed: NDArray[np.bool_], hit_x_m: float) -> tuple[Array, Array]:
    """States (N, 6) where the paths through positions (N, K, 3) at times (N, K) cross x = hit_x_m, and when (N,)."""
    weights = observed.astype(np.float64)
    count = weights.sum(1)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = (weights * t_s).sum(1) / count
        dt = t_s - middle[:, None]
        # Gravity taken off, all three axes are straight lines: p = centre + slope dt.
        straight = ps_m + 0.5 * GRAVITY_MPS2 * np.square(dt)[..., None] * (0.0, 0.0, 1.0)
        centre = (weights[..., None] * straight).sum(1) / count[:, None]
        slope = ((weights * dt)[..., None] * straight).sum(1) / (weights * dt * dt).sum(1)[:, None]
        left = (hit_x_m - centre[:, 0]) / slope[:, 0]
    p = centre + slope * left[:, None]
    p[:, 0] = hit_x_m
    p[:, 2] -= 0.5 * GRAVITY_MPS2 * left**2
    v = slope.copy()
    v[:, 2] -= GRAVITY_MPS2 * left
    states = np.concatenate([p, v], axis=1)
    states[(count < FEWEST) | ~(slope[:, 0] < 0)] = np.nan
    return states, np.where(np.isnan(states[:, 0]), np.nan, middle + left)
