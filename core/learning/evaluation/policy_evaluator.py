"""Evaluation of a policy on fixed balls: return rate and landing error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.policy import ActionSource
from core.learning.config import EnvironmentConfig
from core.learning.evaluation.episode_record import landing_errors_mm
from core.learning.task.environment import ServeBatch, evaluation_balls, play, validation_balls
from core.learning.task.episode_backend import ClosedFormBackend, EpisodeBackend, observe_all
from core.table import TABLE_LENGTH_M

Array = NDArray[np.float64]
BEST = 5
"""Number of best evaluations by which the paper shows each method."""
MISSED_MM: Final = 1000 * TABLE_LENGTH_M
"""Error of a ball that the racket missed (choice): the table's length."""
BallSet = Literal["test", "validation"]
"""Ball sets: one for reported figures, one to choose a run's best policy."""


@dataclass(frozen=True, slots=True, eq=False)
class PolicyScore:
    """A policy on the fixed balls of one speed."""

    speed_mps: float
    returned: NDArray[np.bool_]
    """(N,)."""
    errors_mm: Array
    """(N,) landing extrapolated to the table's plane; NaN where the racket missed."""

    @property
    def missed(self) -> float:
        """Share of balls that the racket did not meet."""
        return float(np.isnan(self.errors_mm).mean())

    @property
    def counted_mm(self) -> Array:
        """(N,) the errors with `MISSED_MM` for balls that the racket did not meet."""
        return np.where(np.isnan(self.errors_mm), MISSED_MM, self.errors_mm)

    @property
    def return_rate(self) -> float:
        """Share of balls that are returned, 0 to 1."""
        return float(self.returned.mean())

    @property
    def error_mm(self) -> float:
        """Mean landing error over all balls, with `MISSED_MM` for missed ones."""
        return float(self.counted_mm.mean())

    @property
    def error_returned_mm(self) -> float:
        """Mean over returned balls; NaN without any."""
        return float(self.errors_mm[self.returned].mean()) if self.returned.any() else float("nan")


class PolicyEvaluator:
    """Evaluates policies on the fixed balls of an environment, which are made once."""

    def __init__(self, config: EnvironmentConfig, balls: int, backend: EpisodeBackend | None = None) -> None:
        """A court shows the balls, once; the strokes are played in closed form, by a racket that is there in time.

        Where outcomes are those that cameras see, every stroke is played out on the court.
        """
        self._config = config
        self._backend = backend or ClosedFormBackend(config)
        self._count = balls
        self._balls: dict[tuple[BallSet, float], ServeBatch] = {}

    def balls(self, speed_mps: float, which: BallSet = "test") -> ServeBatch:
        """The fixed balls of a speed: what figures are reported on, or as many others to choose a policy by."""
        if (which, speed_mps) not in self._balls:
            deal = evaluation_balls if which == "test" else validation_balls
            balls = deal(speed_mps, self._count, self._config)
            self._balls[which, speed_mps] = observe_all(self._backend, balls) if self._is_shown_once else balls
        return self._balls[which, speed_mps]

    @property
    def _is_shown_once(self) -> bool:
        return self._config.state_source == "events" and self._config.outcomes == "told"

    def score(self, controller: ActionSource, speed_mps: float, which: BallSet = "test") -> PolicyScore:
        """Score of a policy on the fixed balls, without noise on the action."""
        balls = self.balls(speed_mps, which)
        if self._config.outcomes == "events":
            return score_played(self._backend, controller, balls)
        return self.score_actions(controller(balls.states, balls.racket_speeds_mps, balls.goals_m), speed_mps, which)

    def score_actions(self, actions: Array, speed_mps: float, which: BallSet = "test") -> PolicyScore:
        """Score of given actions (N, 3) on the fixed balls."""
        balls = self.balls(speed_mps, which)
        outcomes = play(balls, actions, self._config)
        return PolicyScore(speed_mps, outcomes.returned, landing_errors_mm(outcomes, balls.goals_m))


def score_played(
    backend: EpisodeBackend,
    controller: ActionSource,
    balls: ServeBatch,
    progress: Callable[[float], None] = lambda share: None,
) -> PolicyScore:
    """Score of a policy on balls played one after another by the episode backend."""
    returned, errors_mm = np.zeros(len(balls), np.bool_), np.full(len(balls), np.nan)
    for i in range(len(balls)):
        ball = backend.observe(balls[i : i + 1])
        outcome = backend.play(ball, controller(ball.states, ball.racket_speeds_mps, ball.goals_m))
        returned[i], errors_mm[i] = outcome.returned[0], landing_errors_mm(outcome, ball.goals_m)[0]
        progress((i + 1) / len(balls))
    return PolicyScore(balls.speed_mps, returned, errors_mm)


def five_best_mm(errors_mm: Sequence[float]) -> float:
    """Mean of the five lowest of a run's evaluations: the paper's figure, and too kind (it looks at the answers)."""
    found = sorted(error for error in errors_mm if np.isfinite(error))[:BEST]
    return float(np.mean(found)) if found else float("nan")
