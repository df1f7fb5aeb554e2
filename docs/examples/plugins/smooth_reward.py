"""A reward of your own: `rallyscope train --reward smooth --plugin smooth_reward.py --out RUN`.

A returned ball earns the more the nearer it lands to its target, without an edge; any other ball costs something.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.learning.rewards import StrokeResults, Weights, register_reward
from core.physics.episode import Case


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothConfig:
    """Its settings: fields of the form in Train, the section [reward.smooth] of a run's config."""

    width_m: float = setting(0.4, 0.05, 2.0)
    """A ball so far from its target earns 0.61 of the most."""
    lost: float = setting(0.5, 0.0, 5.0)
    """What a ball costs that does not come back."""

    def __post_init__(self) -> None:
        check_settings(self)


def rewards(strokes: StrokeResults, weights: Weights, config: SmoothConfig) -> NDArray[np.float64]:
    """Reward (N,): 1 for returning and up to 3 more for placing."""
    off_m = np.nan_to_num(np.linalg.norm(strokes.landings_m - strokes.goals_m, axis=1), nan=np.inf)
    placed = 3.0 * np.exp(-0.5 * (off_m / config.width_m) ** 2)
    return np.where(strokes.case == Case.RETURNED, 1.0 + weights.w2 * placed, -config.lost)


register_reward("smooth", rewards, "falls off smoothly round the target", config=SmoothConfig)
