"""How sure a prediction is of the bounce and of the crossing of the hitting plane, as ellipses."""

from __future__ import annotations

import numpy as np

from core.history.rally_picture import UncertaintyEllipse
from core.trajectory import Prediction


def spreads_of(prediction: Prediction) -> tuple[UncertaintyEllipse, ...]:
    """Of the next bounce, level, and of the hit, in the hitting plane; of what is expected only."""
    found: list[UncertaintyEllipse] = []
    if prediction.bounces:
        bounce = prediction.bounces[0]
        found.append(
            UncertaintyEllipse(
                bounce.p_world_m, np.array([[bounce.sigma_m[0], 0.0, 0.0], [0.0, bounce.sigma_m[1], 0.0]])
            )
        )
    hit = prediction.hit_plane
    if hit is not None:
        variances, directions = np.linalg.eigh(hit.covariance[1:3, 1:3])
        lengths = np.sqrt(np.maximum(variances, 0.0))
        axes = np.column_stack([np.zeros(2), (directions * lengths).T])
        found.append(UncertaintyEllipse(hit.p_world_m, axes))
    return tuple(found)
