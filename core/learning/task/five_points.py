"""The paper's prediction for many simulated balls at once: five observed positions after the bounce -> p_c, v_c, t_c.

The balls are observed on the simulator's time grid (10 ms). Fast ones reach the racket before five observations; then
the two or more that there are count (choice).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.physics.episode import Arrivals, Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import sample_serves
from core.trajectory import predict_arrivals, predictor_for

Array = NDArray[np.float64]

POINTS: Final = predictor_for("paper").observations


def predict_serves(serves: Serves, arrivals: Arrivals, step_s: float, config: TaskConfig) -> tuple[Array, Array]:
    """Predicted states (N, 6) at the hitting plane and times (N,) there; NaN with fewer than two observations."""
    first = np.floor(arrivals.bounce_t_s / step_s) + 1.0
    t_s: Array = (first[:, None] + np.arange(POINTS)) * step_s
    observed = t_s < arrivals.t_s[:, None]
    ps_m = sample_serves(serves, arrivals, np.where(observed, t_s, arrivals.bounce_t_s[:, None]), config)
    table = predictor_for("real" if config.physics.has_air else "paper")
    return predict_arrivals(
        t_s,
        ps_m,
        observed,
        hit_x_m=config.stroke.hit_plane_x_m,
        restitution=table.restitution,
        tangential_factor=table.tangential_factor,
    )
