"""What the form of a new training holds, as a browser sent it, and the plan that it means, if it means one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeVar, get_args

from app.modes.train.plan import Source, TrainingPlan, offered_agents, parse_episodes, parse_speeds
from core.errors import ConfigError
from core.learning.config import ReplayRule, RewardKind

T = TypeVar("T")
ADVANCE: Final[dict[str, Literal["episodes", "converged"]]] = {
    "after its balls": "episodes",
    "as soon as 98 % come back": "converged",
}
SEEN_AS: Final[dict[str, Source]] = {
    "exactly": "truth",
    "predicted from five points": "predicted",
    "exactly, with noise": "truth+noise",
}
"""How a choice is shown -> what it is."""


@dataclass(frozen=True, slots=True)
class FormValues:
    """The form's values as they came: a browser may send anything."""

    agent: object
    reward: object
    replay: object
    speeds: object
    episodes: object
    advance: object
    source: object
    seeds: object
    first_seed: object


def plan_of_form(form: FormValues) -> TrainingPlan:
    """The plan; `run_of_plan` checks its bounds.

    Raises:
        ConfigError: if a value is none that the form offers, or no number where one belongs.
    """
    speeds = parse_speeds(str(form.speeds))
    return TrainingPlan(
        agent=_choice("agent", form.agent, {name: name for name in offered_agents()}),
        reward=_choice("reward", form.reward, {name: name for name in get_args(RewardKind)}),
        replay=_choice("replay", form.replay, {name: name for name in get_args(ReplayRule)}),
        speeds_mps=speeds,
        episodes=parse_episodes(str(form.episodes), len(speeds)),
        advance=_choice("advance", form.advance, ADVANCE),
        source=_choice("source", form.source, SEEN_AS),
        seeds=_whole("seeds", form.seeds),
        first_seed=_whole("first seed", form.first_seed),
    )


def _choice(what: str, value: object, offered: dict[str, T]) -> T:
    if not isinstance(value, str) or value not in offered:
        raise ConfigError("not offered", expected=", ".join(offered), got=repr(value)[:80], where=what)
    return offered[value]


def _whole(what: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value // 1:
        raise ConfigError("not a whole number", got=repr(value)[:80], where=what)
    return int(value)
