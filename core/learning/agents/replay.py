"""The replay buffer and the three rules for what a new stage of the curriculum keeps of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.learning.config import CurriculumConfig, StateKind
from core.learning.task.normalise import STATE_SIZES

Floats = NDArray[np.float32]

COLUMNS = {
    "state": 6,
    "racket_speed": 1,
    "goal": 2,
    "action": 3,
    "reward": 1,
    "next_state": 6,
    "case": 1,
    "net_z": 1,
    "known": 2,
}
"""Width of each column (of plain states): (s, g, a, r, s') as the paper stores them, and what the landing model learns
from: `next_state` begins with the landing point, `known` tells whether landing and height at the net were really
seen."""


@dataclass(frozen=True, slots=True)
class ReplayStart:
    """Result of the replay rule at a stage's start."""

    kept: int
    dropped: int
    cases: tuple[tuple[int, int, int], ...] = ()
    """Case of the stroke, how many of it were kept, how many dropped: of the cases that there were, ascending.

    Not known of a checkpoint that an earlier version wrote."""


class ReplayBuffer:
    """Transitions of a run in the order of their episodes; sampled uniformly, with replacement."""

    def __init__(self, capacity: int, state: StateKind = "plain", action_size: int = 3) -> None:
        widths = COLUMNS | dict.fromkeys(("state", "next_state"), STATE_SIZES[state]) | {"action": action_size}
        self._columns = {name: np.zeros((capacity, width), np.float32) for name, width in widths.items()}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def capacity(self) -> int:
        """Largest number of transitions."""
        return len(self._columns["state"])

    def add(self, transition: dict[str, NDArray[np.floating]]) -> None:
        """Append one transition: a row of every column."""
        for name, column in self._columns.items():
            column[self._count] = transition[name]
        self._count += 1

    def column(self, name: str) -> Floats:
        """The rows (len, width) of a column so far."""
        return self._columns[name][: self._count]

    def sample(self, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
        """Row numbers (count,) to learn from."""
        return rng.integers(0, self._count, count)

    def keep(self, mask: NDArray[np.bool_]) -> ReplayStart:
        """Drop all other rows."""
        kept = int(mask.sum())
        dropped = self._count - kept
        cases = self.column("case")[:, 0].astype(int)
        by_case = tuple(
            (int(case), int((cases[mask] == case).sum()), int((cases[~mask] == case).sum()))
            for case in np.unique(cases)
        )
        for column in self._columns.values():
            column[:kept] = column[: self._count][mask]
        self._count = kept
        return ReplayStart(kept, dropped, by_case)

    def to_arrays(self) -> dict[str, Floats]:
        """Complete state, for a checkpoint."""
        return {name: column[: self._count].copy() for name, column in self._columns.items()}

    def restore(self, arrays: dict[str, Floats]) -> None:
        """Restore the state from `to_arrays`."""
        self._count = len(arrays["state"])
        for name, column in self._columns.items():
            column[: self._count] = arrays[name]


def start_stage(buffer: ReplayBuffer, config: CurriculumConfig) -> ReplayStart:
    """Apply the replay rule between two stages (paper: threshold on the stored reward)."""
    if config.replay == "threshold":
        return buffer.keep(buffer.column("reward")[:, 0] >= config.keep_reward - 1e-6)
    return buffer.keep(np.full(len(buffer), config.replay == "retain"))
