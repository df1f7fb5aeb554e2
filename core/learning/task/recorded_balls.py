"""Balls of human play in place of drawn serves: read once, split by flight into training, validation and test.

Every state in a file begins a flight of its own, so a flight is never on both sides. Neighbours in a file may be
strokes of one rally: they stay together in blocks, and whole blocks are assigned to the parts, always in the same way.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.task.drawn_worlds import select_arrivals
from core.physics.ball_states import join_serves, read_ball_states
from core.physics.episode import Arrivals, Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.incoming import fly_incoming

BallPart = Literal["training", "validation", "test"]
PARTS: Final[tuple[BallPart, ...]] = ("training", "validation", "test")
SHARES: Final = (0.7, 0.1, 0.2)
BLOCK: Final = 50
"""Flights that follow one another in a file and stay together."""
SPLIT_SEED: Final = 20260407
"""Fixed: no run tests on balls that another one has learned from."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedBalls:
    """Playable balls and how they arrive."""

    serves: Serves
    arrivals: Arrivals


def recorded_balls(place: str, part: BallPart, task: TaskConfig) -> RecordedBalls:
    """The playable balls of a part, in the order of the files.

    Raises:
        ConfigError: if there is nothing playable.
        RecordingError: if a file cannot be read, or holds something else.
    """
    return _parts(tuple((path, path.stat().st_mtime_ns) for path in ball_state_files(place)), task)[PARTS.index(part)]


def ball_state_files(place: str) -> tuple[Path, ...]:
    """The file, or the files of the folder: those whose names end in `.json`.

    Raises:
        ConfigError: if there is no such place, or nothing in it.
    """
    path = Path(place)
    found = tuple(sorted(path.glob("*.json"))) if path.is_dir() else (path,) if path.is_file() else ()
    if not found:
        expected = "serves, spinning, a file of ball states, or a folder of such .json files"
        raise ConfigError("no recorded balls", expected=expected, where=place)
    return found


def part_of_flights(count: int, block: int = BLOCK) -> NDArray[np.int8]:
    """(N,) the place in PARTS of each flight of a file."""
    blocks = -(-count // block)
    edges = np.round(np.cumsum(SHARES) * blocks).astype(int)
    parts = np.searchsorted(edges, np.random.default_rng(SPLIT_SEED).permutation(blocks), side="right")
    return np.repeat(parts, block)[:count].astype(np.int8)


@functools.lru_cache(maxsize=4)
def _parts(files: tuple[tuple[Path, int], ...], task: TaskConfig) -> tuple[RecordedBalls, ...]:
    """Balls by part, see `PARTS`; changed files are read again."""
    read = [read_ball_states(path) for path, _ in files]
    balls = join_serves(read)
    flown, part = fly_incoming(balls, task).arrivals, np.zeros(0)
    # A selection of a few flights has too few blocks: then they are as large as leaves no part without a playable ball.
    for block in range(BLOCK, 0, -1):
        part = np.concatenate([part_of_flights(len(one), block) for one in read])
        if len(np.unique(part[flown.legal])) == len(PARTS):
            break
    found = []
    for number, name in enumerate(PARTS):
        which = flown.legal & (part == number)
        if not which.any():
            where = ", ".join(path.name for path, _ in files)
            raise ConfigError(f"no playable ball for {name}", got=f"{len(balls)} ball states", where=where)
        found.append(RecordedBalls(balls[which], select_arrivals(flown, which)))
    return tuple(found)
