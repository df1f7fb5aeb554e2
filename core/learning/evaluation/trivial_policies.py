"""What needs no learning: doing nothing, chance, always the same landing, and the best that the racket could do.

They stand beside every result, because they decide what it is worth: with an open racket doing nothing returns nearly
every ball, and landing always in the middle of the target box is 298 mm off on the average.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.learning.config import EnvironmentConfig
from core.learning.evaluation.episode_record import landing_errors_mm
from core.learning.evaluation.policy_evaluator import PolicyEvaluator, PolicyScore
from core.learning.task.environment import Deliveries, play

Array = NDArray[np.float64]

COARSE, FINE, ROUNDS = 15, 7, 5
"""The oracle's grid over the two angles that matter, and how often it zooms in around the best point."""
NOT_RETURNED_MM = 1e5


@dataclass(frozen=True, slots=True)
class TrivialScores:
    """Scores without learning on the fixed balls of a speed."""

    zero: PolicyScore
    """The base orientation."""
    random: PolicyScore
    """Uniform random angles."""
    constant_mm: float
    """Mean distance from the middle of the target box to the targets: what hitting only the middle would score."""
    oracle: PolicyScore
    """The best angles per ball, found through the simulator itself."""


def score_trivial_policies(evaluator: PolicyEvaluator, speed_mps: float, config: EnvironmentConfig) -> TrivialScores:
    """Score every policy that needs no learning."""
    balls = evaluator.balls(speed_mps)
    rng = np.random.default_rng(0)
    return TrivialScores(
        evaluator.score_actions(np.zeros((len(balls), 3)), speed_mps),
        evaluator.score_actions(rng.uniform(-1, 1, (len(balls), 3)), speed_mps),
        float(1000 * np.hypot(*(balls.goals_m - np.array(config.goal.centre_m)).T).mean()),
        evaluator.score_actions(oracle_actions(balls, config), speed_mps),
    )


def oracle_actions(balls: Deliveries, config: EnvironmentConfig) -> Array:
    """The best action (N, 3) per ball: a grid over pitch and yaw, then finer ones around its best point.

    The turn of the face about its own normal changes nothing in a rigid impact and stays zero.
    """
    n = len(balls)
    best = np.zeros((n, 3))
    width = 1.0
    for round_ in range(1 + ROUNDS):
        side = np.linspace(-width, width, COARSE if round_ == 0 else FINE)
        offsets = np.array([(0.0, b, c) for b in side for c in side])
        tried = np.clip(best[:, None] + offsets, -1, 1)
        cost = _costs(balls, tried, config)
        best = tried[np.arange(n), cost.argmin(axis=1)]
        width *= 2 / (len(side) - 1) * 1.5
    return best


def trusting_actions(balls: Deliveries, config: EnvironmentConfig) -> Array:
    """What the oracle would do (N, 3) if it took the perceived state for the true one: what noise alone costs."""
    states = balls.arrivals.states.copy()
    states[:, :6] = balls.states
    believed = dataclasses.replace(
        balls,
        arrivals=dataclasses.replace(balls.arrivals, states=states),
        aim_ps_m=None,
        aim_t_s=None,
        action_errors=np.zeros((len(balls), 3)),
    )
    return oracle_actions(believed, config)


def _costs(balls: Deliveries, actions: Array, config: EnvironmentConfig) -> Array:
    """(N, K) of actions (N, K, 3): the landing error, and much for a ball that does not come back."""
    n, k = actions.shape[:2]
    repeated = balls[np.repeat(np.arange(n), k)]
    outcomes = play(repeated, actions.reshape(-1, 3), config)
    cost = np.nan_to_num(landing_errors_mm(outcomes, repeated.goals_m), nan=NOT_RETURNED_MM)
    return np.where(outcomes.returned, cost, cost + NOT_RETURNED_MM).reshape(n, k)
