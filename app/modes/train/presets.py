"""Trainings that can be started with a click, and what a browser may ask of one at most."""

from __future__ import annotations

import dataclasses
import importlib.util
from dataclasses import dataclass
from typing import Final, get_args

from core.errors import ConfigError
from core.learning.config import AgentName, CurriculumConfig, RunConfig, StateSource, default_run

MAX_STAGES: Final = 10
MAX_EPISODES: Final = 20_000
"""Of one stage; what a browser may start is bounded."""
MAX_SEEDS: Final = 50
EVALUATIONS_PER_STAGE: Final = 10
"""At least: a short stage is evaluated, and its policy kept, more often than every 50 episodes."""
SB3_NEEDS: Final = ("stable_baselines3", "sb3_contrib")
SOURCES: Final[tuple[StateSource, ...]] = ("predicted", "truth", "truth+noise")
"""Not `events`: a second a ball is for the command line."""
PACES: Final[dict[str, float | None]] = {
    "as fast as it goes": None,
    "20 balls a second": 20.0,
    "5 balls a second": 5.0,
    "2.5 balls a second": 2.5,
    "1 ball a second": 1.0,
}
"""What the speed control offers."""


@dataclass(frozen=True, slots=True)
class Preset:
    """A run with a name and a pace."""

    slug: str
    """What its runs are called."""
    config: RunConfig
    pace: str = "as fast as it goes"


def _landing_model(*speeds_mps: float, episodes: int = 100, source: StateSource = "truth") -> RunConfig:
    run = default_run("landing-model")
    stages = dataclasses.replace(run.curriculum, speeds_mps=speeds_mps, episodes=(episodes,) * len(speeds_mps))
    environment = dataclasses.replace(run.environment, state_source=source)
    return dataclasses.replace(run, environment=environment, curriculum=stages)


TRAIN_NOW: Final = "From missing to placing in a minute"
PRESETS: Final[dict[str, Preset]] = {
    TRAIN_NOW: Preset("first", _landing_model(5.0), "2.5 balls a second"),
    "The paper: 800 balls at 3 m/s, 900 at 5 m/s": Preset("paper", default_run("ddpg")),
    "The paper's agent straight at 5 m/s": Preset(
        "scratch", RunConfig(curriculum=CurriculumConfig(speeds_mps=(5.0,), episodes=(1700,)))
    ),
    "Landing model: 300 balls at 5 m/s": Preset("model", _landing_model(5.0, episodes=300)),
    "Landing model: curriculum to 9 m/s": Preset("curriculum", _landing_model(5.0, 6.0, 7.0, 8.0, 9.0)),
    "Landing model, noisy perception": Preset("noisy", _landing_model(5.0, episodes=300, source="truth+noise")),
    "For comparison: TD3 at 5 m/s": Preset("td3", default_run("td3")),
}


def offered_agents() -> tuple[AgentName, ...]:
    """Agents that can be trained here: those of stable-baselines3 need it."""
    ours: tuple[AgentName, ...] = ("ddpg", "landing-model")
    has_sb3 = all(importlib.util.find_spec(name) is not None for name in SB3_NEEDS)
    return get_args(AgentName) if has_sb3 else ours


def offered_presets() -> tuple[str, ...]:
    """Names of the presets whose agents can be trained here."""
    agents = offered_agents()
    return tuple(name for name, preset in PRESETS.items() if preset.config.agent in agents)


def startable_run(config: RunConfig) -> RunConfig:
    """The run that a browser starts: short stages are evaluated more often.

    Raises:
        ConfigError: if it is more than a browser may ask for.
    """
    curriculum, source = config.curriculum, config.environment.state_source
    if config.agent not in offered_agents():
        raise ConfigError("not offered", expected=", ".join(offered_agents()), got=config.agent, where="agent")
    if source not in SOURCES:
        raise ConfigError("not offered", expected=", ".join(SOURCES), got=source, where="state source")
    if len(curriculum.speeds_mps) > MAX_STAGES:
        raise ConfigError("not a curriculum", expected=f"1 to {MAX_STAGES} speeds", where="speeds")
    if max(curriculum.episodes) > MAX_EPISODES:
        raise ConfigError("not so many", expected=f"1 to {MAX_EPISODES} a stage", where="episodes")
    if config.seeds > MAX_SEEDS:
        raise ConfigError("not so many", expected=f"1 to {MAX_SEEDS}", got=config.seeds, where="seeds")
    every = max(1, min(config.checkpoint_every, min(curriculum.episodes) // EVALUATIONS_PER_STAGE))
    return dataclasses.replace(config, checkpoint_every=every)
