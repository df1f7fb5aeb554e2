"""Policies with the whole chain in the loop: played out before event cameras ball by ball, and perhaps trained there.

A ball takes a second or more of computing, so these trainings are few; each is kept, and an interrupted one goes on.
"""

from __future__ import annotations

import contextlib
import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.plan import Counts
from benchmarks.learning.runs import fingerprint
from core.errors import ConfigError
from core.files import read_json, write_json
from core.learning.config import RunConfig, default_run
from core.learning.evaluation.policy_evaluator import PolicyScore, score_played
from core.learning.runs.run_files import create_run, load_policy
from core.learning.runs.running import run_training
from core.learning.task.environment import evaluation_balls
from core.live.worlds.event_environment import EventCameraBackend, EventEnvironmentConfig

SPEED_MPS: Final = 5.0
SEEN_BALLS: Final = 20
"""Of the evaluations during the training, each seen by the cameras once: they are not reported."""


@dataclass(frozen=True, slots=True, eq=False)
class PlayedSeed:
    """What one trained seed did with balls that were played out before the cameras."""

    seed: int
    returned: NDArray[np.bool_]
    errors_mm: NDArray[np.float64]
    """(N,) NaN where the racket missed."""

    @property
    def score(self) -> PolicyScore:
        """The outcome as a score."""
        return PolicyScore(SPEED_MPS, self.returned, self.errors_mm)


@dataclass(frozen=True, slots=True)
class PlayedTraining:
    """A training whose policies are then played out before event cameras."""

    name: str
    config: RunConfig
    """Trained before the cameras if its states are from events, otherwise in closed form."""
    seeds: int
    balls: int
    """That each seed is evaluated on."""
    told: bool
    """Whether the chain is told the physics exactly; otherwise it finds out."""

    @property
    def trains_there(self) -> bool:
        """Before the cameras."""
        return self.config.environment.state_source == "events"

    @property
    def balls_played(self) -> int:
        """By one seed, before the cameras."""
        return self.balls + self.trains_there * self.config.episodes


def event_training(counts: Counts) -> PlayedTraining:
    """The landing model at 5 m/s, its states from events."""
    base = default_run("landing-model")
    config = replace(
        base,
        environment=replace(base.environment, state_source="events"),
        curriculum=replace(base.curriculum, speeds_mps=(SPEED_MPS,), episodes=(counts.event_episodes,)),
        checkpoint_every=max(1, min(50, counts.event_episodes)),
        evaluation_balls=min(SEEN_BALLS, counts.event_balls),
    )
    return PlayedTraining("events", config, counts.event_seeds, counts.event_balls, told=True)


def play_seed(training: PlayedTraining, folder: Path, seed: int) -> bool:
    """Train and evaluate one seed; False if it is in the folder already."""
    path = _path(training, folder, seed)
    if path.exists():
        return False
    config, run = replace(training.config, seeds=1, first_seed=seed), path.with_suffix(".run")
    if not (run / "config.toml").is_file():
        shutil.rmtree(run, ignore_errors=True)
        create_run(run, config)
    world_backend = replace(config.environment, state_source="events")
    with contextlib.closing(
        EventCameraBackend(world_backend, seed=seed, config=EventEnvironmentConfig(knows_physics=training.told))
    ) as seen:
        run_training(run, backend=seen if training.trains_there else None)
        balls = evaluation_balls(SPEED_MPS, training.balls, world_backend)
        score = score_played(seen, load_policy(run, seed), balls)
    errors = [None if math.isnan(error) else error for error in score.errors_mm.tolist()]
    write_json(path, {"returned": score.returned.tolist(), "errors_mm": errors})
    shutil.rmtree(run)
    return True


def load_played(training: PlayedTraining, folder: Path) -> list[PlayedSeed]:
    """What there is of its seeds."""
    found = []
    for seed in range(training.seeds):
        if answer := read_json(_path(training, folder, seed)):
            found.append(_played(seed, answer))
    return found


def _played(seed: int, answer: dict[str, object]) -> PlayedSeed:
    returned, errors = answer.get("returned"), answer.get("errors_mm")
    if not (isinstance(returned, Sequence) and isinstance(errors, Sequence) and len(returned) == len(errors) > 0):
        raise ConfigError("not a seed's balls", expected="outcome and error of each ball", where=f"events, seed {seed}")
    numbers = np.array([math.nan if error is None else error for error in errors], np.float64)
    return PlayedSeed(seed, np.array(returned, np.bool_), numbers)


def _path(training: PlayedTraining, folder: Path, seed: int) -> Path:
    """Named by what is trained and on how many balls it is judged."""
    name = f"{training.name}-{fingerprint(training.config)}-{training.balls}-balls"
    return folder / name / f"seed-{seed}.json"
