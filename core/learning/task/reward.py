"""Reward of an outcome, by the reward that a config names."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.config import get_section
from core.errors import AgentError
from core.learning.rewards import (
    REWARDS,
    Array,
    RewardConfig,
    StrokeResults,
    Weights,
    distance_to_far_half,
    section_name,
)
from core.physics.episode import Case, Outcomes

__all__ = ["Weights", "distance_to_far_half", "episode_rewards", "reward_weights", "rewards_of"]


def reward_weights(episode: int, config: RewardConfig) -> Weights:
    """The weights at the `episode`-th ball (from 0) of this speed."""
    return REWARDS[config.kind].weights(episode, _settings(config))


def episode_rewards(
    outcomes: Outcomes, goals_m: Array, weights: Weights, config: RewardConfig, *, where: str = ""
) -> Array:
    """Reward (N,) of outcomes for goals (N, 2); `where` tells of which episode, in messages.

    Args:
        outcomes: of N balls.
        goals_m: (N, 2) targets on the table.
        weights: of accuracy and return, as the episode has them.
        config: kind and constants.
        where: episode and seed, for messages.

    Raises:
        AgentError: if the reward gives anything but a finite number for each.
    """
    return rewards_of(outcomes.case, outcomes.landings_m, outcomes.net_z_m, goals_m, weights, config, where=where)


def rewards_of(
    case: NDArray[np.integer],
    landings_m: Array,
    net_z_m: Array,
    goals_m: Array,
    weights: Weights,
    config: RewardConfig,
    *,
    where: str = "",
) -> Array:
    """Rewards (N,) from the parts of an outcome: case (N,), landing (N, 2), m, height at the net (N,), m.

    Args:
        case: (N,) values of `Case`.
        landings_m: (N, 2) landing points in the table's plane.
        net_z_m: (N,) height over the net's plane.
        goals_m: (N, 2) targets.
        weights: of accuracy and return, as the episode has them.
        config: kind and constants of the reward.
        where: place for the error's message.

    Raises:
        AgentError: if the reward gives anything but a finite number for each.
    """
    given = REWARDS[config.kind].rewards(StrokeResults(case, landings_m, net_z_m, goals_m), weights, _settings(config))
    place = f"{where}, stroke" if where else "stroke"
    try:
        rewards = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise AgentError(f"the reward {config.kind} is no number", got=repr(given)[:80], where=where or None) from error
    # Rewards may come from a plugin: one number for all would broadcast silently.
    if rewards.shape != (len(case),):
        expected, got = f"{len(case)} numbers", f"shape {rewards.shape}"
        raise AgentError(f"the reward {config.kind} is no number", expected=expected, got=got, where=where or None)
    bad = np.flatnonzero(~np.isfinite(rewards))
    if len(bad):
        at = int(bad[0])
        raise AgentError(
            f"the reward {config.kind} is no number",
            expected="a finite number",
            got=float(rewards[at]),
            where=f"{place} {at}, {Case(int(case[at])).name.lower().replace('_', ' ')}",
            remedy="landings and heights are NaN where the racket missed the ball",
        )
    return rewards


def _settings(config: RewardConfig) -> object:
    """The reward's own section, or all of it."""
    own = REWARDS[config.kind].config
    return config if own is None else get_section(config, section_name(config.kind))
