"""What a controller decides on a predicted ball: the value that the player, the recording and the app share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.simulation.episodes.racket import RacketTarget
from core.trajectory.prediction import Stage

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RacketDecision:
    """Where the racket is sent, what for, and what is expected to come of it."""

    t_us: int = 0
    """End of the window that led to it; 0 from a controller, which knows of no windows."""
    stage: Stage
    """Stage of the prediction it answers."""
    state: Array
    """(6,) predicted p_c and v_c at the hitting plane; NaN where a recording does not say."""
    goal_m: Array
    """(2,) wanted landing point."""
    target: RacketTarget
    action: Array
    """(3,) in [-1, 1]: the orientation as q = q_base qx qy qz, in units of the action limit."""
    landing_m: Array | None = None
    """(2,) expected landing point; None before the orientation is decided, or where nobody computes it."""
    net_z_m: float | None = None
    """Expected height of the ball's centre over the net."""
