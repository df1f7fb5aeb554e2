"""The line in the time bar that shows where a scored config found, missed and invented balls."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.panels.time_bar import Runs
from core.detection import DetectorConfig
from core.detection.methods import Method

NO_RUNS: Final = Runs(np.zeros(0, np.int64), np.zeros(0, np.int64), ())


@dataclass(frozen=True, slots=True)
class ScoredConfig:
    """What a score is of."""

    camera: str
    method: Method
    config: DetectorConfig


@dataclass(frozen=True, slots=True)
class ShownWindow:
    """A window that Tune shows."""

    camera: str
    t_us: int
    """Its end."""
    miss_px: float | None
    """Distance of its ball from the truth, infinite if there is none; None without a ball or a truth."""


class VerdictLine:
    """Shows the verdicts of the last score while its camera, method and config are those of the picture."""

    def __init__(self, show: Callable[[Runs], None]) -> None:
        self._show = show
        self._scored: ScoredConfig | None = None
        self._runs = self._visible = NO_RUNS

    def keep(self, scored: ScoredConfig, runs: Runs) -> None:
        """Keep the verdicts of a score in place of the last one's."""
        self._scored, self._runs = scored, runs

    def follow(self, shown: ScoredConfig | None) -> None:
        """Show the verdicts if they are of what is on the screen, else none; None: nothing of Tune is."""
        wanted = self._runs if shown is not None and shown == self._scored else NO_RUNS
        if wanted is not self._visible:
            self._visible = wanted
            self._show(wanted)

    def forget(self) -> None:
        """Drop the verdicts: another recording was opened, whose time bar has none."""
        self._scored, self._runs, self._visible = None, NO_RUNS, NO_RUNS
