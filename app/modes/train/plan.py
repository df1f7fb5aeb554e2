"""What a person asks a training to be: a plan of plain choices, presets of it, and the run that it becomes."""

from __future__ import annotations

import dataclasses
import importlib.util
from dataclasses import dataclass
from typing import Final, Literal, get_args

from core.errors import ConfigError
from core.learning.config import AgentName, ReplayRule, RewardKind, RunConfig, default_run

MOST_STAGES: Final = 10
MOST_EPISODES: Final = 20_000
"""Of one stage; what a browser may start is bounded."""
MOST_SEEDS: Final = 50
MOST_FIRST_SEED: Final = 10_000
EVALUATIONS_PER_STAGE: Final = 10
"""At least: a short stage is evaluated, and its policy kept, more often than every 50 episodes."""
RIVALS_NEED: Final = ("stable_baselines3", "sb3_contrib")
Source = Literal["predicted", "truth", "truth+noise"]
SOURCES: Final[tuple[Source, ...]] = get_args(Source)
"""Not `events`: a second a ball is for the command line."""
PACES: Final[dict[str, float | None]] = {
    "as fast as it goes": None,
    "20 balls a second": 20.0,
    "5 balls a second": 5.0,
    "2.5 balls a second": 2.5,
    "1 ball a second": 1.0,
}
"""What the speed control offers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingPlan:
    """One training, as the form shows it."""

    agent: AgentName = "landing-model"
    reward: RewardKind = "cdta"
    replay: ReplayRule = "retain"
    speeds_mps: tuple[float, ...] = (5.0,)
    episodes: tuple[int, ...] = (100,)
    advance: Literal["episodes", "converged"] = "episodes"
    source: Source = "truth"
    seeds: int = 1
    first_seed: int = 0


@dataclass(frozen=True, slots=True)
class Preset:
    """A plan with a name and a pace."""

    slug: str
    """What its runs are called."""
    plan: TrainingPlan
    pace: str = "as fast as it goes"


TRAIN_NOW: Final = "From missing to placing in a minute"
PRESETS: Final[dict[str, Preset]] = {
    TRAIN_NOW: Preset("first", TrainingPlan(), "2.5 balls a second"),
    "The paper: 800 balls at 3 m/s, 900 at 5 m/s": Preset(
        "paper",
        TrainingPlan(agent="ddpg", replay="threshold", speeds_mps=(3.0, 5.0), episodes=(800, 900), source="predicted"),
    ),
    "The paper's agent straight at 5 m/s": Preset(
        "scratch", TrainingPlan(agent="ddpg", replay="threshold", episodes=(1700,), source="predicted")
    ),
    "Landing model: 300 balls at 5 m/s": Preset("model", TrainingPlan(episodes=(300,))),
    "Landing model: curriculum to 9 m/s": Preset(
        "ladder", TrainingPlan(speeds_mps=(5.0, 6.0, 7.0, 8.0, 9.0), episodes=(100,) * 5)
    ),
    "Landing model, noisy perception": Preset("noisy", TrainingPlan(episodes=(300,), source="truth+noise")),
    "A rival: TD3 at 5 m/s": Preset("td3", TrainingPlan(agent="td3", reward="case", episodes=(1700,))),
}


def offered_agents() -> tuple[AgentName, ...]:
    """Agents that can be trained here: the rivals need their libraries."""
    ours: tuple[AgentName, ...] = ("ddpg", "landing-model")
    has_rivals = all(importlib.util.find_spec(name) is not None for name in RIVALS_NEED)
    return get_args(AgentName) if has_rivals else ours


def offered_presets() -> tuple[str, ...]:
    """Names of the presets whose agents can be trained here."""
    agents = offered_agents()
    return tuple(name for name, preset in PRESETS.items() if preset.plan.agent in agents)


def run_of_plan(plan: TrainingPlan) -> RunConfig:
    """The whole configuration of a plan: what is not in it is the agent's default.

    Raises:
        ConfigError: if a value is not one that is offered.
    """
    _check(plan)
    config = default_run(plan.agent)
    curriculum = dataclasses.replace(
        config.curriculum,
        speeds_mps=plan.speeds_mps,
        episodes=plan.episodes,
        advance=plan.advance,
        replay=plan.replay,
    )
    every = max(1, min(config.checkpoint_every, min(plan.episodes) // EVALUATIONS_PER_STAGE))
    return dataclasses.replace(
        config,
        environment=dataclasses.replace(config.environment, state_source=plan.source),
        reward=dataclasses.replace(config.reward, kind=plan.reward),
        curriculum=curriculum,
        seeds=plan.seeds,
        first_seed=plan.first_seed,
        checkpoint_every=every,
    )


def _check(plan: TrainingPlan) -> None:
    choices: tuple[tuple[str, str, tuple[str, ...]], ...] = (
        ("agent", plan.agent, offered_agents()),
        ("reward", plan.reward, get_args(RewardKind)),
        ("replay", plan.replay, get_args(ReplayRule)),
        ("advance", plan.advance, ("episodes", "converged")),
        ("source", plan.source, SOURCES),
    )
    for what, value, offered in choices:
        if value not in offered:
            raise ConfigError("not offered", expected=", ".join(offered), got=repr(value)[:80], where=what)
    if not 1 <= len(plan.speeds_mps) <= MOST_STAGES:
        raise ConfigError("not a curriculum", expected=f"1 to {MOST_STAGES} speeds", where="speeds")
    if not all(1 <= count <= MOST_EPISODES for count in plan.episodes):
        raise ConfigError("not so many", expected=f"1 to {MOST_EPISODES} a stage", where="episodes")
    for what, value, low, high in (
        ("seeds", plan.seeds, 1, MOST_SEEDS),
        ("first seed", plan.first_seed, 0, MOST_FIRST_SEED),
    ):
        if not low <= value <= high:
            raise ConfigError("out of range", expected=f"{low} to {high}", got=f"{value:g}", where=what)


def parse_speeds(text: str) -> tuple[float, ...]:
    """Serve speeds from what a person typed: "3, 5".

    Raises:
        ConfigError: if that is no list of numbers.
    """
    try:
        return tuple(float(part) for part in _parts(text))
    except ValueError:
        raise ConfigError("not a list of speeds", expected="such as 3, 5", got=repr(text[:80])) from None


def parse_episodes(text: str, stages: int) -> tuple[int, ...]:
    """Balls per stage from what a person typed; one number is for all stages.

    Raises:
        ConfigError: if that is no list of whole numbers.
    """
    try:
        counts = tuple(int(part) for part in _parts(text))
    except ValueError:
        raise ConfigError("not a list of numbers of balls", expected="such as 800, 900", got=repr(text[:80])) from None
    return counts * stages if len(counts) == 1 else counts


def _parts(text: str) -> list[str]:
    parts = text[:200].replace(",", " ").split()
    if not 1 <= len(parts) <= MOST_STAGES or any(len(part) > 12 for part in parts):
        raise ValueError(text)
    return parts


def numbers_text(values: tuple[float, ...] | tuple[int, ...]) -> str:
    """Numbers as a text field shows them; equal ones once."""
    shown = values[:1] if len(set(values)) == 1 else values
    return ", ".join(f"{value:g}" for value in shown)
