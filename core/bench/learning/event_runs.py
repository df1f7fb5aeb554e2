"""The landing model with the whole chain in the loop: trained before event cameras, and evaluated there ball by ball.

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

from core.bench.learning.plan import Counts
from core.bench.learning.runs import fingerprint
from core.errors import ConfigError
from core.files import read_json, write_json
from core.learning.config import RunConfig, default_run
from core.learning.evaluation.policy_evaluator import PolicyScore, score_played
from core.learning.runs.run_files import create_run, load_policy
from core.learning.runs.running import run_training
from core.learning.task.environment import evaluation_balls
from core.rally.simulated.event_environment import EventCameraBackend, EventCourtConfig

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
        """The same as a score."""
        return PolicyScore(SPEED_MPS, self.returned, self.errors_mm)


def event_training(counts: Counts) -> RunConfig:
    """The landing model at 5 m/s, its states from events."""
    base = default_run("landing-model")
    return replace(
        base,
        environment=replace(base.environment, state_source="events"),
        curriculum=replace(base.curriculum, speeds_mps=(SPEED_MPS,), episodes=(counts.event_episodes,)),
        checkpoint_every=max(1, min(50, counts.event_episodes)),
        evaluation_balls=min(SEEN_BALLS, counts.event_balls),
        seeds=counts.event_seeds,
    )


def play_event_seed(counts: Counts, folder: Path, seed: int) -> bool:
    """Train and evaluate one seed; False if it is in the folder already."""
    path = _path(counts, folder, seed)
    if path.exists():
        return False
    config, run = replace(event_training(counts), seeds=1, first_seed=seed), path.with_suffix(".run")
    if not (run / "config.toml").is_file():
        shutil.rmtree(run, ignore_errors=True)
        create_run(run, config)
    with contextlib.closing(
        EventCameraBackend(config.environment, seed=seed, config=EventCourtConfig(told=True))
    ) as backend:
        run_training(run, backend=backend)
        balls = evaluation_balls(SPEED_MPS, counts.event_balls, config.environment)
        score = score_played(backend, load_policy(run, seed), balls)
    errors = [None if math.isnan(error) else error for error in score.errors_mm.tolist()]
    write_json(path, {"returned": score.returned.tolist(), "errors_mm": errors})
    shutil.rmtree(run)
    return True


def load_event_seeds(counts: Counts, folder: Path) -> list[PlayedSeed]:
    """What there is of them."""
    found = []
    for seed in range(counts.event_seeds):
        if answer := read_json(_path(counts, folder, seed)):
            found.append(_played(seed, answer, counts.event_balls))
    return found


def _played(seed: int, answer: dict[str, object], balls: int) -> PlayedSeed:
    returned, errors = answer.get("returned"), answer.get("errors_mm")
    if not (isinstance(returned, Sequence) and isinstance(errors, Sequence) and len(returned) == len(errors) == balls):
        raise ConfigError("not a seed's balls", expected=f"{balls} balls", where=f"events, seed {seed}")
    numbers = np.array([math.nan if error is None else error for error in errors], np.float64)
    return PlayedSeed(seed, np.array(returned, np.bool_), numbers)


def _path(counts: Counts, folder: Path, seed: int) -> Path:
    """Named by what is trained and on how many balls it is judged."""
    name = f"events-{fingerprint(event_training(counts))}-{counts.event_balls}-balls"
    return folder / name / f"seed-{seed}.json"
