"""Policies without learning: no action, random, constant landing, and an oracle.

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
from core.learning.task.environment import ServeBatch, play

Array = NDArray[np.float64]

COARSE, FINE, ROUNDS = 15, 7, 5
CHOSEN_COARSE, CHOSEN_FINE, CHOSEN_ROUNDS, CHOSEN_ZOOM = (9, 5, 9), 3, 12, 0.6
"""Search grid where the racket's speed is searched too: tilts, turns and speeds of the first grid, and of finer ones,
each so much narrower than the one before."""
"""The oracle's grid over the two angles that matter, and how often it zooms in around the best point."""
NOT_RETURNED_MM = 1e5


@dataclass(frozen=True, slots=True)
class TrivialScores:
    """Scores of trivial policies on the fixed balls of one speed."""

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


def oracle_actions(balls: ServeBatch, config: EnvironmentConfig) -> Array:
    """The best action (N, 3) per ball: a grid over pitch and yaw, then finer ones around its best point.

    Where the racket's speed is chosen that is searched too, and actions are (N, 4).

    The turn of the face about its own normal changes nothing in a rigid impact and stays zero.
    """
    if config.racket == "chosen":
        return _best_with_speed(balls, config)
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


def _best_with_speed(balls: ServeBatch, config: EnvironmentConfig) -> Array:
    """(N, 4), as `oracle_actions`."""
    n = len(balls)
    best, widths = np.zeros((n, 4)), np.ones(3)
    for round_ in range(1 + CHOSEN_ROUNDS):
        counts = CHOSEN_COARSE if round_ == 0 else (CHOSEN_FINE,) * 3
        sides = [np.linspace(-width, width, count) for width, count in zip(widths, counts, strict=True)]
        offsets = np.array([(0.0, b, c, v) for b in sides[0] for c in sides[1] for v in sides[2]])
        tried = np.clip(best[:, None] + offsets, -1, 1)
        cost = _costs(balls, tried, config)
        best = tried[np.arange(n), cost.argmin(axis=1)]
        widths *= 2 / (np.array(counts) - 1) if round_ == 0 else CHOSEN_ZOOM
    return best


def trusting_actions(balls: ServeBatch, config: EnvironmentConfig) -> Array:
    """What the oracle would do (N, 3) if it took the perceived state for the true one: what noise alone costs."""
    states = balls.arrivals.states.copy()
    known = min(balls.states.shape[1], states.shape[1])  # a state with spin has its uncertainty behind that
    states[:, :known] = balls.states[:, :known]
    believed = dataclasses.replace(
        balls,
        arrivals=dataclasses.replace(balls.arrivals, states=states),
        aim_ps_m=None,
        aim_t_s=None,
        action_errors=np.zeros((len(balls), 3)),
    )
    return oracle_actions(believed, config)


def _costs(balls: ServeBatch, actions: Array, config: EnvironmentConfig) -> Array:
    """(N, K) of actions (N, K, 3 or 4): the landing error, and much for a ball that does not come back."""
    n, k = actions.shape[:2]
    repeated = balls[np.repeat(np.arange(n), k)]
    outcomes = play(repeated, actions.reshape(n * k, -1), config)
    cost = np.nan_to_num(landing_errors_mm(outcomes, repeated.goals_m), nan=NOT_RETURNED_MM)
    return np.where(outcomes.returned, cost, cost + NOT_RETURNED_MM).reshape(n, k)
