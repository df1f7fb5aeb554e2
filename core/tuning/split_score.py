"""Score of a config: figures of both sides of the split, and the objective to maximise."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from core.metrics.grid_score import GridScore
from core.metrics.score import MATCH_RADIUS_PX

COST_PER_PX: Final = 0.02
"""A pixel of median error is worth two points of F1: enough to decide between configs that find the same balls, and too
little to pay for losing some."""
WORST: Final = -COST_PER_PX * MATCH_RADIUS_PX
"""Score of a config that finds nothing, or that is invalid."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of one side of the split; nan where a denominator is 0."""

    precision: float
    """Share of the answers that are a ball."""
    recall: float
    """Share of the balls asked for that are found."""
    median_error_px: float
    objective: float
    """F1 of the two, less `COST_PER_PX` times the median error: at most 1, at least `WORST`."""
    balls: int
    """Times at which a ball was asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class SplitScore:
    """Counts and errors of a config on both sides; they add up over cameras."""

    tuned: GridScore = field(default_factory=GridScore)
    """Figures of the tuned side."""
    held_out: GridScore = field(default_factory=GridScore)
    """Figures of the held-out side."""

    def __add__(self, other: SplitScore) -> SplitScore:
        return SplitScore(self.tuned + other.tuned, self.held_out + other.held_out)


def figures_of(score: GridScore) -> Figures:
    """The figures of counts and errors."""
    hits = score.precision + score.recall
    f1 = 2 * score.precision * score.recall / hits if hits > 0 else 0.0  # nan is not above 0 either
    median = score.error_at(50)
    error = median if median < MATCH_RADIUS_PX else MATCH_RADIUS_PX  # nothing found counts as the largest error
    return Figures(score.precision, score.recall, median, f1 - COST_PER_PX * error, score.asked)
