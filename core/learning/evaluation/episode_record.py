"""One line of `metrics.jsonl`: everything about an episode that a table, a plot or a replay in 3D needs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.agent import Losses
from core.learning.agents.replay import ReplayStart
from core.learning.task.environment import ServeBatch, racket_speeds_of
from core.learning.task.reward import Weights
from core.physics.episode import Case, Outcomes

Array = NDArray[np.float64]
NET_PASSED_M = -1e-6
"""A first contact beyond this x is in or behind the net plane."""


def transition_of(
    delivery: ServeBatch, action: Array, outcome: Outcomes, reward: float
) -> dict[str, NDArray[np.floating]]:
    """The replay row of one played ball (arrays of one row)."""
    missed = outcome.case[0] == Case.MISSED
    return {
        "state": delivery.states[0],
        "racket_speed": delivery.racket_speeds_mps,
        "goal": delivery.goals_m[0],
        "action": action,
        "reward": np.array([reward]),
        # After a miss there is no landing; nothing learns from it, it only must not be NaN.
        "next_state": delivery.states[0] if missed else _known_exactly(outcome.landing_states[0], delivery),
        "case": np.array([float(outcome.case[0])]),
        "net_z": outcome.net_z_m,
        "known": really_seen(outcome)[0].astype(np.float64),
    }


def _known_exactly(landing: Array, delivery: ServeBatch) -> Array:
    """The state (9,) of a landing as a state of the kind that the delivery has, without any uncertainty."""
    size = delivery.states.shape[1]
    return landing[:6] if size == 6 else np.concatenate([np.nan_to_num(landing), np.zeros(size - len(landing))])


def really_seen(outcomes: Outcomes) -> NDArray[np.bool_]:
    """(N, 2) whether the ball reached the table's plane, and the net plane, before it touched anything."""
    landed = outcomes.contact_t_s >= outcomes.landing_t_s - 1e-9
    passed = ~np.isnan(outcomes.net_z_m) & (outcomes.contact_states[:, 0] >= NET_PASSED_M)
    return np.column_stack([landed, passed])


def landing_errors_mm(outcomes: Outcomes, goals_m: Array) -> Array:
    """(N,) from the landing point in the table's plane to the target; NaN where the racket missed."""
    return 1000 * np.hypot(*(outcomes.landings_m - goals_m).T)


def episode_line(
    *,
    episode: int,
    stage: int,
    stage_episode: int,
    delivery: ServeBatch,
    action: Array,
    noise: float,
    is_random: bool,
    outcome: Outcomes,
    reward: float,
    weights: Weights,
    buffer: int,
    kept: ReplayStart | None,
    losses: Losses,
) -> dict[str, object]:
    """Line about one episode; `kept` only at the start of a stage."""
    line: dict[str, object] = {
        "episode": episode,
        "stage": stage,
        "stage_episode": stage_episode,
        "speed_mps": delivery.speed_mps,
        "case": int(outcome.case[0]),
        "reward": _plain(reward),
        "error_mm": _plain(landing_errors_mm(outcome, delivery.goals_m)[0]),
        "landing_m": _plains(outcome.landings_m[0]),
        "goal_m": _plains(delivery.goals_m[0]),
        "net_z_m": _plain(outcome.net_z_m[0]),
        "noise": _plain(noise),
        "random": is_random,
        "w1": _plain(weights.w1),
        "w2": _plain(weights.w2),
        "buffer": buffer,
        "critic_loss": _plain(losses.critic),
        "actor_loss": _plain(losses.actor),
        "serve": _plains(delivery.serves.states()[0]),
        "state": _plains(delivery.states[0]),
        "action": _plains(action),
        "racket_speed_mps": _plain(racket_speeds_of(action[None], delivery.racket_speeds_mps)[0]),
    }
    if delivery.aim_ps_m is not None and delivery.aim_t_s is not None:
        line["aim_m"], line["aim_t_s"] = _plains(delivery.aim_ps_m[0]), _plain(delivery.aim_t_s[0])
    if kept is not None:
        line["kept"], line["dropped"] = kept.kept, kept.dropped
        if kept.cases:
            line["kept_cases"] = {str(case): [some, others] for case, some, others in kept.cases}
    return line


def _plain(value: float) -> float | None:
    """Number rounded to micrometres; None (JSON null) if unknown."""
    return round(float(value), 6) if math.isfinite(value) else None


def _plains(values: Array) -> list[float | None]:
    return [_plain(value) for value in values.tolist()]
