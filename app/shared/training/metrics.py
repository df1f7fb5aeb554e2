"""The growing files of a run as arrays: one row per episode, read on from where the last look ended."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.runs.run_files import read_lines, seed_files
from core.text.json_text import parse_json

Array = NDArray[np.float64]
COLUMNS: Final = ("case", "reward", "error_mm", "noise", "w1", "w2", "speed_mps")
WIDTH: Final = len(COLUMNS) + 4
LARGEST: Final = 1e300
"""A damaged line may hold whole numbers of hundreds of digits."""
RECENT: Final = 24
"""Whole lines that are kept, to play those balls again."""
FILES_KEPT: Final = 64
LAST_LINE_BYTES: Final = 1024
"""More than an evaluation's line."""


@dataclass(frozen=True, slots=True, eq=False)
class Metrics:
    """Episodes of one seed, in order; NaN for what is not known."""

    columns: dict[str, Array]
    """Each (N,), by the names in COLUMNS."""
    landings_m: Array
    """(N, 2)."""
    goals_m: Array
    """(N, 2)."""
    evaluations: tuple[dict[str, object], ...]
    recent: tuple[dict[str, object], ...]
    """The newest lines, oldest first."""
    stage_starts: tuple[dict[str, object], ...] = ()
    """The lines that tell what a new stage kept of the replay buffer."""

    def __len__(self) -> int:
        return len(self.landings_m)


class MetricsReader:
    """Reads the metrics of one seed.

    A file that got shorter, because a resumed run cut off what it makes again, is read anew.
    """

    def __init__(self, run: Path, seed: int) -> None:
        self._files = seed_files(run, seed)
        self._forget()

    def read(self) -> Metrics:
        """Everything that is written by now.

        Raises:
            ConfigError: if something else has written there.
        """
        if _size(self._files.metrics) < self._at or _size(self._files.evaluations) < self._evaluations_at:
            self._forget()
        try:
            return self._read_on()
        except ConfigError as error:
            self._forget()
            raise ConfigError("a broken line in the metrics", got=error, where=self._files.folder) from error

    def _read_on(self) -> Metrics:
        lines, self._at = read_lines(self._files.metrics, self._at)
        if lines:
            self._append(lines)
            self._recent.extend(lines)
            self._stage_starts.extend(line for line in lines if "kept" in line)
        more, self._evaluations_at = read_lines(self._files.evaluations, self._evaluations_at)
        self._evaluations.extend(more)
        rows = self._rows[: self._count]
        columns = {name: rows[:, k].copy() for k, name in enumerate(COLUMNS)}
        return Metrics(
            columns,
            rows[:, -4:-2].copy(),
            rows[:, -2:].copy(),
            tuple(self._evaluations),
            tuple(self._recent),
            tuple(self._stage_starts),
        )

    def _append(self, lines: list[dict[str, object]]) -> None:
        needed = self._count + len(lines)
        if needed > len(self._rows):
            grown = np.empty((max(needed, 2 * len(self._rows)), WIDTH))
            grown[: self._count] = self._rows[: self._count]
            self._rows = grown
        self._rows[self._count : needed] = [_row(line) for line in lines]
        self._count = needed

    def _forget(self) -> None:
        self._at = self._evaluations_at = self._count = 0
        self._rows = np.empty((256, WIDTH))
        self._recent: deque[dict[str, object]] = deque(maxlen=RECENT)
        self._stage_starts: list[dict[str, object]] = []
        self._evaluations: list[dict[str, object]] = []


class MetricsStore:
    """Readers of many runs, shared by all browsers; those not asked for lately are forgotten."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._readers: OrderedDict[tuple[Path, int], MetricsReader] = OrderedDict()

    def read(self, run: Path, seed: int) -> Metrics:
        """The episodes of a seed of a run; empty if there are none."""
        with self._lock:
            key = (run, seed)
            reader = self._readers.setdefault(key, MetricsReader(run, seed))
            self._readers.move_to_end(key)
            while len(self._readers) > FILES_KEPT:
                self._readers.popitem(last=False)
            return reader.read()


def last_line(path: Path) -> dict[str, object] | None:
    """The last complete line of a .jsonl file; None if there is none."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, _size(path) - LAST_LINE_BYTES))
            complete = file.read().split(b"\n")[:-1]
        line = parse_json(complete[-1])
    except (OSError, IndexError, ValueError):
        return None
    return line if isinstance(line, dict) else None


def _row(line: dict[str, object]) -> list[float]:
    numbers = [line.get(name) for name in COLUMNS]
    for name in ("landing_m", "goal_m"):
        point = line.get(name)
        numbers += point if isinstance(point, list) and len(point) == 2 else [None, None]
    return [_number(number) for number in numbers]


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) and abs(value) < LARGEST else float("nan")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
