"""Runs of the landing model that take a moment."""

import dataclasses

from app.modes.train.form import startable_run
from core.learning.config import RunConfig, default_run


def small_run(
    *, speeds_mps: tuple[float, ...] = (5.0,), episodes: tuple[int, ...] = (100,), seeds: int = 1
) -> RunConfig:
    """A run as a browser starts it."""
    run = default_run("landing-model")
    curriculum = dataclasses.replace(run.curriculum, speeds_mps=speeds_mps, episodes=episodes)
    return startable_run(dataclasses.replace(run, curriculum=curriculum, seeds=seeds))
