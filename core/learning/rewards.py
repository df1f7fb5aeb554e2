"""Registry of rewards, and ours. Ours are the paper's case-dependent temporally adaptive reward (CDTA)
and its two rivals.

The paper defines its distances in a figure only; ours are choices: d from the landing point to the target, d2 from the
landing point to the net plane, d3 to the nearest edge of the opponent's half.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import Sections, check_config_type, check_settings, choice, open_sections, setting
from core.errors import PluginError
from core.physics.episode import Case
from core.registry import Registry
from core.table import NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
RewardKind = str
"""The name of a reward in `REWARDS`."""


@dataclass(frozen=True, slots=True)
class Weights:
    """How much returning the ball (w1) and placing it (w2) count at an episode."""

    w1: float
    w2: float


@dataclass(frozen=True, slots=True, eq=False)
class StrokeResults:
    """Outcomes and targets of N strokes."""

    case: NDArray[np.integer]
    """(N,) a `Case` each."""
    landings_m: Array
    """(N, 2) in the table's plane; NaN where it is not known."""
    net_z_m: Array
    """(N,) height at the net over the table; NaN where it is not known."""
    goals_m: Array
    """(N, 2) where each was to land."""


@dataclass(frozen=True, slots=True)
class Reward:
    """A reward, as `register_reward` describes it."""

    rewards: Callable[[StrokeResults, Weights, Any], Array]
    label: str
    weights: Callable[[int, Any], Weights]
    config: type | None


REWARDS: Final[Registry[Reward]] = Registry("reward", "rallyscope.rewards")
"""Every reward by name."""


def section_name(reward: str) -> str:
    """The name of the section with the settings of a reward."""
    return reward.replace("-", "_")


def placing_only(episode: int, config: object) -> Weights:
    """Placing counts from the first ball on."""
    return Weights(0.0, 1.0)


def register_reward(
    name: str,
    rewards: Callable[[StrokeResults, Weights, Any], Array],
    label: str,
    *,
    weights: Callable[[int, Any], Weights] = placing_only,
    config: type | None = None,
) -> None:
    """Add a reward: to `train --reward` and the form of the mode Train.

    Args:
        name: of the reward; with underscores it is the section of its settings in [reward].
        rewards: gives the reward (N,) of strokes, from the weights of their episode and the settings.
        label: what it is, in a line.
        weights: of an episode, counted from 0 at each speed.
        config: its settings, a frozen dataclass with defaults; None: it takes the `RewardConfig`.

    Raises:
        PluginError: if the name is taken, or one of these does not fit.
    """
    where = f"reward {name}"
    if not callable(rewards) or not callable(weights):
        raise PluginError("no way to work it out", expected="rewards(strokes, weights, config)", where=where)
    if not isinstance(label, str) or not label.strip():
        raise PluginError("no label", expected="a line that says what it is", got=repr(label), where=where)
    if config is not None:
        check_config_type(config, where)
    REWARDS.register(name, Reward(rewards, label, weights, config))


@dataclass(frozen=True, slots=True, kw_only=True)
class RewardConfig:
    """CDTA (the paper's, time-weighted), case-based with constant weights, simple, and registered rewards."""

    kind: RewardKind = choice("cdta", REWARDS)
    """cdta: case-dependent temporally adaptive (the paper's), first for returning, later for placing; case: constant
    weights for each case; simple: returned or not, or how near to the target."""
    base: float = setting(1.0, 0.1, 10.0)
    """l_base: a returned ball (choice)."""
    scale: float = setting(3.0, 0.0, 20.0)
    """l_scale: the most that accuracy adds (choice)."""
    beta: float = setting(0.02, 0.0, 0.5)
    """CDTA: the weight of returning is exp(-beta n), n the episode at this speed (choice)."""
    case_weight: float = setting(0.5, 0.0, 1.0)
    """Case-based: the constant weight of returning (w1); accuracy has the rest."""
    own_half: float = setting(1.0, 0.0, 10.0)
    """l1, case 1."""
    net: float = setting(1.0, 0.0, 10.0)
    """l2, case 2."""
    out: float = setting(1.0, 0.0, 10.0)
    """l3, case 3."""
    missed: float = setting(1.0, 0.0, 10.0)
    """Penalty when the racket does not touch the ball, which the paper's simulation does not know (choice)."""
    reach_m: float = setting(1.0, 0.1, 3.0)
    """d_max: from here on accuracy adds nothing (choice)."""
    own_half_reach_m: float = setting(TABLE_LENGTH_M / 2, 0.1, 3.0)
    """d_max2 (choice)."""
    out_reach_m: float = setting(2.0, 0.1, 5.0)
    """d_max3 (choice)."""
    net_height_m: float = setting(NET_HEIGHT_M, 0.1, 0.3)
    """h_net."""
    simple_accuracy: bool = False
    """Simple: a returned ball also earns its accuracy; otherwise l_base alone."""
    registered: Sections = open_sections(
        REWARDS.view(lambda one: one.config or object, where=lambda one: one.config is not None, key=section_name)
    )
    """Settings of each other registered reward that has some: a section of its name."""

    def __post_init__(self) -> None:
        check_settings(self)


def _cdta_weights(episode: int, config: RewardConfig) -> Weights:
    w1 = math.exp(-config.beta * episode)
    return Weights(w1, 1 - w1)


def _case_weights(episode: int, config: RewardConfig) -> Weights:
    return Weights(config.case_weight, 1 - config.case_weight)


def _simple_weights(episode: int, config: RewardConfig) -> Weights:
    return Weights(0.0, 1.0) if config.simple_accuracy else Weights(1.0, 0.0)


def _simple_rewards(strokes: StrokeResults, weights: Weights, config: RewardConfig) -> Array:
    """Rewards of returned balls; 0 for all others."""
    off = _ratio(_distance(strokes.landings_m, strokes.goals_m), config.reach_m)
    accuracy = config.base + config.scale * (1 - off)
    return np.where(strokes.case == Case.RETURNED, weights.w1 * config.base + weights.w2 * accuracy, 0.0)


def _case_rewards(strokes: StrokeResults, weights: Weights, config: RewardConfig) -> Array:
    """Rewards of returned balls, and penalties by what happened to the others."""
    case, landings_m = strokes.case, strokes.landings_m
    rewards = _simple_rewards(strokes, weights, config)
    short = _ratio(np.abs(landings_m[:, 0]), config.own_half_reach_m)
    rewards = np.where(case == Case.OWN_HALF, -config.own_half * short, rewards)
    # Bounded as a whole: a ball under the table's plane at the net costs l2, one in the upper half of the cord nothing.
    low = np.clip(1 - np.nan_to_num(strokes.net_z_m) / config.net_height_m, 0, 1)
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


register_reward("cdta", _case_rewards, "the paper's: first for returning, later for placing", weights=_cdta_weights)
register_reward("case", _case_rewards, "constant weights for each case", weights=_case_weights)
register_reward("simple", _simple_rewards, "returned or not, or how near to the target", weights=_simple_weights)
REWARDS.mark_built_in()
