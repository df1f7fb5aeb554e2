"""What an outcome is worth: the paper's case-dependent temporally adaptive reward (CDTA), and its two rivals.

The paper defines its distances in a figure only; ours are choices: d from the landing point to the target, d2 from the
landing point to the net plane, d3 to the nearest edge of the opponent's half.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.learning.config import RewardConfig
from core.physics.episode import Case, Outcomes
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Weights:
    """How much returning the ball (w1) and placing it (w2) count at an episode."""

    w1: float
    w2: float


def reward_weights(episode: int, config: RewardConfig) -> Weights:
    """The weights at the `episode`-th ball (from 0) of this speed."""
    if config.kind == "cdta":
        w1 = math.exp(-config.beta * episode)
        return Weights(w1, 1 - w1)
    if config.kind == "case":
        return Weights(config.case_weight, 1 - config.case_weight)
    return Weights(0.0, 1.0) if config.simple_accuracy else Weights(1.0, 0.0)


def episode_rewards(outcomes: Outcomes, goals_m: Array, weights: Weights, config: RewardConfig) -> Array:
    """Reward (N,) of outcomes for goals (N, 2)."""
    return rewards_of(outcomes.case, outcomes.landings_m, outcomes.net_z_m, goals_m, weights, config)


def rewards_of(
    case: NDArray[np.integer], landings_m: Array, net_z_m: Array, goals_m: Array, weights: Weights, config: RewardConfig
) -> Array:
    """Rewards (N,) from the parts of an outcome: case (N,), landing (N, 2), m, height at the net (N,), m."""
    accuracy = config.base + config.scale * (1 - _ratio(_distance(landings_m, goals_m), config.reach_m))
    rewards = np.where(case == Case.RETURNED, weights.w1 * config.base + weights.w2 * accuracy, 0.0)
    if config.kind == "simple":
        return rewards
    rewards = np.where(
        case == Case.OWN_HALF, -config.own_half * _ratio(np.abs(landings_m[:, 0]), config.own_half_reach_m), rewards
    )
    # Bounded as a whole: a ball under the table's plane at the net costs l2, one in the upper half of the cord nothing.
    low = np.clip(1 - np.nan_to_num(net_z_m) / config.net_height_m, 0, 1)
    rewards = np.where(case == Case.NET, -config.net * low, rewards)
    outside = -config.out * _ratio(distance_to_far_half(landings_m), config.out_reach_m)
    rewards = np.where(case == Case.OUT, outside, rewards)
    return np.where(case == Case.MISSED, -config.missed, rewards)


def distance_to_far_half(points_m: ArrayLike) -> Array:
    """Distance (N,) of points (N, 2) in the table's plane to the opponent's half; 0 inside."""
    p = np.asarray(points_m, np.float64)
    dx = np.maximum(np.maximum(-p[:, 0], p[:, 0] - TABLE_LENGTH_M / 2), 0)
    dy = np.maximum(np.abs(p[:, 1]) - TABLE_WIDTH_M / 2, 0)
    return np.hypot(dx, dy)


def _ratio(distance: Array, reach: float) -> Array:
    """distance / reach clipped to [0, 1]; a landing that is not known counts as far away."""
    return np.clip(np.nan_to_num(distance, nan=reach) / reach, 0, 1)


def _distance(a: Array, b: Array) -> Array:
    return np.hypot(a[:, 0] - b[:, 0], a[:, 1] - b[:, 1])
