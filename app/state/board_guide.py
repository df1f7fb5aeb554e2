"""Where a calibration board has been found in the cameras' pictures, as one frozen value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from app.state.swept_cells import SweptCells
from core.cameras.calibration import Board

FIRST_BOARD: Final = Board("chessboard", 6, 9, 0.03)
"""Until another is chosen; where it has been does not depend on the spacing."""


@dataclass(frozen=True, slots=True)
class BoardGuide:
    """The board that is looked for, and what it has covered."""

    board: Board = FIRST_BOARD
    cells: SweptCells = field(default_factory=lambda: SweptCells(enough=1))
    """Looked for and shown while they are active."""
    pictures: Mapping[str, int] = field(default_factory=dict)
    """With the whole board in them, by camera."""

    def with_board(self, camera: str, cells: Iterable[int]) -> BoardGuide:
        """The board was found once more, with points in these cells of a camera's picture."""
        covered = self.cells
        for cell in cells:
            covered = covered.with_ball(camera, cell)
        return replace(self, cells=covered, pictures={**self.pictures, camera: self.pictures.get(camera, 0) + 1})

    def emptied(self) -> BoardGuide:
        """A copy with nothing seen yet."""
        return BoardGuide(self.board, SweptCells(self.cells.active, enough=1))
