"""Racket speed for an arriving ball: the table of serve speeds, indexed by the speed of arrival."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from core.learning.config import RunConfig
from core.physics.episode import Arrivals
from core.physics.task import STAGE_SPEEDS_MPS, ServeConfig, TaskConfig
from core.simulation.episodes.closed_form import fly_serves
from core.simulation.episodes.serve import draw_serves

Floats = NDArray[np.float32]
SAMPLE = 64
"""Serves per speed: their arrival speeds differ by 1 %."""


def racket_table(config: RunConfig) -> tuple[Floats, Floats]:
    """Mean speed of arrival along x, ascending, and the racket's speed, both (K,), of the run's stages.

    Recorded balls have all speeds, and so the whole table.
    """
    task = config.environment.task
    if config.environment.recorded:
        return _whole_table(task)
    return _table(task, tuple(sorted(set(config.curriculum.speeds_mps))))


def racket_speeds(arrivals: Arrivals, task: TaskConfig) -> NDArray[np.float64]:
    """(N,) racket speed for arriving balls, m/s."""
    return np.interp(-arrivals.states[:, 3], *_whole_table(task))


def _whole_table(task: TaskConfig) -> tuple[Floats, Floats]:
    return _table(dataclasses.replace(task, serve=ServeConfig()), STAGE_SPEEDS_MPS)


@functools.lru_cache(maxsize=16)
def _table(task: TaskConfig, speeds_mps: tuple[float, ...]) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(0)
    incoming = [
        -np.nanmean(fly_serves(draw_serves(speed, SAMPLE, task, rng), task).states[:, 3]) for speed in speeds_mps
    ]
    racket = [task.stroke.racket_speed.at(speed) for speed in speeds_mps]
    return np.array(incoming, np.float32), np.array(racket, np.float32)
