"""Progress of online learning: one row per ball, frozen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from core.physics.episode import Case

Array = NDArray[np.float64]
WINDOW: Final = 10
"""Number of balls in a median or share."""


@dataclass(frozen=True, slots=True)
class LearnedBall:
    """A ball that the learning policy played."""

    case: Case
    error_mm: float
    """From the target to the landing; NaN where the ball did not come down anywhere on its way."""
    learned: bool
    """Whether the policy chose the stroke, so that it could be learned from."""
    random: bool
    """Whether the stroke was a random one."""


@dataclass(frozen=True, slots=True, eq=False)
class LearningProgress:
    """Progress since learning began, or was reset."""

    start: str
    """Name of the run that it began from, or `start.NOTHING`."""
    balls: tuple[LearnedBall, ...]
    problem: str = ""
    """Why a ball was not learned from, if one was not for an unexpected reason."""

    @property
    def learned(self) -> int:
        """Balls that were learned from."""
        return sum(ball.learned for ball in self.balls)

    @property
    def returned(self) -> int:
        """Balls that came back."""
        return sum(ball.case is Case.RETURNED for ball in self.balls)

    @property
    def returned_lately(self) -> tuple[int, int]:
        """How many of the last balls came back, and how many those are."""
        last = self.balls[-WINDOW:]
        return sum(ball.case is Case.RETURNED for ball in last), len(last)

    def errors_mm(self) -> tuple[Array, Array]:
        """(N,) error of each ball and the median of it and those before it, `WINDOW` in all.

        A ball whose landing is not known counts there as farther away than any; NaN where the median is one of these.
        """
        errors = np.array([ball.error_mm for ball in self.balls], np.float64)
        far = np.where(np.isnan(errors), np.inf, errors)
        begun = [np.median(far[:end]) for end in range(1, min(WINDOW, len(far) + 1))]
        full = np.median(sliding_window_view(far, WINDOW), axis=1) if len(far) >= WINDOW else []
        medians = np.array([*begun, *full], np.float64)
        return errors, np.where(np.isfinite(medians), medians, np.nan)
