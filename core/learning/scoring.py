"""How good a policy is: the fixed balls, return rate and landing error, last and five best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.learning.config import EnvironmentConfig
from core.learning.environment import Deliveries, evaluation_balls, play
from core.learning.episode_record import landing_errors_mm
from core.learning.policy import Controller

Array = NDArray[np.float64]
BEST = 5
"""The paper shows each method by the five best of its evaluations."""


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """A policy on the fixed balls of one speed."""

    speed_mps: float
    returned: NDArray[np.bool_]
    """(N,)."""
    errors_mm: Array
    """(N,) landing extrapolated to the table's plane; NaN where the racket missed."""

    @property
    def return_rate(self) -> float:
        """0..1."""
        return float(self.returned.mean())

    @property
    def error_mm(self) -> float:
        """Mean over every ball that the racket met."""
        return float(np.nanmean(self.errors_mm)) if np.isfinite(self.errors_mm).any() else float("nan")

    @property
    def error_returned_mm(self) -> float:
        """Mean over returned balls; NaN without any."""
        return float(self.errors_mm[self.returned].mean()) if self.returned.any() else float("nan")


class Examiner:
    """Evaluates policies on the fixed balls of an environment, which are made once."""

    def __init__(self, config: EnvironmentConfig, balls: int) -> None:
        self._config = config
        self._count = balls
        self._balls: dict[float, Deliveries] = {}

    def balls(self, speed_mps: float) -> Deliveries:
        """The fixed balls of a speed."""
        if speed_mps not in self._balls:
            self._balls[speed_mps] = evaluation_balls(speed_mps, self._count, self._config)
        return self._balls[speed_mps]

    def score(self, controller: Controller, speed_mps: float) -> Score:
        """A policy on them, without noise on the action."""
        balls = self.balls(speed_mps)
        return self.score_actions(controller(balls.states, balls.racket_speeds_mps, balls.goals_m), speed_mps)

    def score_actions(self, actions: Array, speed_mps: float) -> Score:
        """Given actions (N, 3) on them."""
        balls = self.balls(speed_mps)
        outcomes = play(balls, actions, self._config)
        return Score(speed_mps, outcomes.returned, landing_errors_mm(outcomes, balls.goals_m))


def five_best_mm(errors_mm: Sequence[float]) -> float:
    """Mean of the five lowest of a run's evaluations: the paper's figure, and too kind (it looks at the answers)."""
    found = sorted(error for error in errors_mm if np.isfinite(error))[:BEST]
    return float(np.mean(found)) if found else float("nan")
