"""Which parts of the cameras' pictures the swept ball, or a board, has been in, as one frozen value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from core.cameras.calibration.coverage import CELLS_ACROSS, CELLS_DOWN

CELL_COUNT: Final = CELLS_ACROSS * CELLS_DOWN
ENOUGH: Final = 2
"""Pictures with the ball in a cell, so that one false circle does not count."""


@dataclass(frozen=True, slots=True)
class SweptCells:
    """Counts of each camera's cells, up to `enough`."""

    active: bool = False
    """Whether they are counted and shown."""
    counts: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    enough: int = ENOUGH

    def with_ball(self, camera: str, cell: int) -> SweptCells:
        """The ball was in this cell of a camera's picture once more."""
        before = self.counts.get(camera, (0,) * CELL_COUNT)
        if not 0 <= cell < CELL_COUNT or before[cell] >= self.enough:
            return self
        after = (*before[:cell], before[cell] + 1, *before[cell + 1 :])
        return replace(self, counts={**self.counts, camera: after})

    def missing(self, camera: str) -> tuple[int, ...]:
        """Cells of a camera's picture that the ball has not been in."""
        counts = self.counts.get(camera, (0,) * CELL_COUNT)
        return tuple(cell for cell, count in enumerate(counts) if count < self.enough)
