"""Reward of an outcome, by the reward that a config names."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.config import get_section
from core.learning.rewards import (
    REWARDS,
    Array,
    RewardConfig,
    StrokeResults,
    Weights,
    distance_to_far_half,
    section_name,
)
from core.physics.episode import Outcomes

__all__ = ["Weights", "distance_to_far_half", "episode_rewards", "reward_weights", "rewards_of"]


def reward_weights(episode: int, config: RewardConfig) -> Weights:
    """The weights at the `episode`-th ball (from 0) of this speed."""
    return REWARDS[config.kind].weights(episode, _settings(config))


def episode_rewards(outcomes: Outcomes, goals_m: Array, weights: Weights, config: RewardConfig) -> Array:
    """Reward (N,) of outcomes for goals (N, 2)."""
    return rewards_of(outcomes.case, outcomes.landings_m, outcomes.net_z_m, goals_m, weights, config)


def rewards_of(
    case: NDArray[np.integer], landings_m: Array, net_z_m: Array, goals_m: Array, weights: Weights, config: RewardConfig
) -> Array:
    """Rewards (N,) from the parts of an outcome: case (N,), landing (N, 2), m, height at the net (N,), m."""
    return REWARDS[config.kind].rewards(StrokeResults(case, landings_m, net_z_m, goals_m), weights, _settings(config))


def _settings(config: RewardConfig) -> object:
    """The reward's own section, or all of it."""
    own = REWARDS[config.kind].config
    return config if own is None else get_section(config, section_name(config.kind))
