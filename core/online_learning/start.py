"""What online learning starts from, nothing or a run of the landing model, and the run that it is saved as."""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import WRITE_REMEDY, ConfigError
from core.learning.agents.policy import Policy, save_policy
from core.learning.config import (
    CurriculumConfig,
    EnvironmentConfig,
    ExplorationConfig,
    GoalConfig,
    LandingModelConfig,
    RunConfig,
)
from core.learning.runs.run_files import (
    RunStatus,
    create_run,
    load_checkpoint,
    read_run,
    save_checkpoint,
    seed_files,
    seeds_of,
    write_status,
)
from core.physics.task import STAGE_SPEEDS_MPS

Arrays = dict[str, NDArray[np.generic]]
NOTHING: Final = "scratch (untrained)"
"""In place of a run: no run of a workspace has such a name, with a space in it."""
EXPLORATION: Final = ExplorationConfig(random_episodes=10, scale=0.1, decay=0.93, smallest=0.005)
"""Ten random strokes as in training; the noise falls faster, as people watch: 0.02 of the range after 22 balls."""

GOALS: Final = GoalConfig(low_x_m=0.25, high_x_m=1.25, half_width_m=0.65)
"""Targets: nearly every place that a user can choose."""


@dataclass(frozen=True, slots=True, eq=False)
class LearningStart:
    """Start of learning, also after a reset."""

    name: str
    """Name of the run, or `NOTHING`."""
    config: RunConfig
    arrays: Arrays
    """Arrays of the run's checkpoint; empty for `NOTHING`."""


def start_from_nothing() -> LearningStart:
    """Untrained landing model, for serves of every speed."""
    speeds = STAGE_SPEEDS_MPS
    config = RunConfig(
        agent="landing-model",
        environment=EnvironmentConfig(state_source="events", goal=GOALS),
        landing_model=LandingModelConfig(head="process"),
        exploration=EXPLORATION,
        curriculum=CurriculumConfig(speeds_mps=speeds, episodes=(1,) * len(speeds), replay="retain"),
    )
    return LearningStart(NOTHING, config, {})


def can_start_from(run: Path) -> bool:
    """Whether a run is one of the landing model, has a checkpoint, and knows its balls without their spin."""
    try:
        config = read_run(run)
    except ConfigError:
        return False
    return _can_go_on(config) and any(seed_files(run, seed).checkpoint.is_file() for seed in seeds_of(run)[:1])


def start_from_run(run: Path) -> LearningStart:
    """Agent and balls of a run's first seed, to resume from.

    Raises:
        ConfigError: if it is no run of the landing model on plain states, or has no checkpoint that can be read.
    """
    config = read_run(run)
    if not _can_go_on(config):
        raise ConfigError(
            "not a run that can go on learning here",
            expected="the landing model on states without spin",
            got=f"{config.agent}, state {config.environment.state}",
            where=run,
            remedy="train one with --agent landing-model, or start from nothing",
        )
    seeds = seeds_of(run)
    if not seeds:
        raise ConfigError("a run without a policy", where=run, remedy="train it first")
    arrays, _ = load_checkpoint(seed_files(run, seeds[0]).checkpoint)
    config = dataclasses.replace(config, exploration=dataclasses.replace(EXPLORATION, random_episodes=0))
    return LearningStart(run.name, config, arrays)


def _can_go_on(config: RunConfig) -> bool:
    return config.agent == "landing-model" and config.environment.state == "plain"


def save_as_run(run: Path, config: RunConfig, policy: Policy, arrays: Arrays, about: dict[str, object]) -> None:
    """Save as a finished run of one seed; it is a run only once the last file is written.

    Raises:
        ConfigError: if there is one already, or it cannot be written.
    """
    if (run / "config.toml").exists():
        raise ConfigError("there is a run already", where=run, remedy="take another name")
    files, episodes = seed_files(run, 0), config.episodes
    try:
        files.folder.mkdir(parents=True, exist_ok=True)
        save_policy(policy, files.policy)
        save_checkpoint(files.checkpoint, arrays, about)
        speed_mps = config.curriculum.speeds_mps[-1]
        write_status(run, RunStatus("finished", os.getpid(), 0, episodes, episodes, 1.0, speed_mps, 0.0))
    except OSError as error:
        raise ConfigError("the run cannot be written", got=error.strerror, where=run, remedy=WRITE_REMEDY) from error
    create_run(run, dataclasses.replace(config, seeds=1, first_seed=0))
