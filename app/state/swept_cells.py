"""What a calibration has been shown: the parts of each picture that a ball, or a board, has been in, and the corners
of the table that were clicked.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Final

from core.cameras.calibration import Board
from core.cameras.calibration.coverage import CELL_COUNT
from core.cameras.calibration.table_corners import CORNERS

ENOUGH: Final = 2
"""Pictures with the ball needed per cell, so that one false circle does not count."""


PAIR_ENOUGH: Final = 30
"""Pictures in which two cameras see the ball at once: what `calibrate rig` wants of a pair."""


@dataclass(frozen=True, slots=True)
class SweptCells:
    """Counts of each camera's cells, up to `enough`."""

    active: bool = False
    """Whether cells are counted and shown."""
    counts: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    enough: int = ENOUGH
    shared: Mapping[tuple[str, str], int] = field(default_factory=dict)
    """Pictures in which two cameras saw the ball at once, by their names in ascending order, up to `PAIR_ENOUGH`."""

    def with_ball(self, camera: str, cell: int) -> SweptCells:
        """Copy with one more picture of the ball in this cell of a camera."""
        before = self.counts.get(camera, (0,) * CELL_COUNT)
        if not 0 <= cell < CELL_COUNT or before[cell] >= self.enough:
            return self
        after = (*before[:cell], before[cell] + 1, *before[cell + 1 :])
        return replace(self, counts={**self.counts, camera: after})

    def with_balls(self, cameras: Iterable[str]) -> SweptCells:
        """All of these cameras saw the ball in one picture."""
        counts = {pair: self.shared.get(pair, 0) for pair in combinations(sorted(set(cameras)), 2)}
        more = {pair: count + 1 for pair, count in counts.items() if count < PAIR_ENOUGH}
        return replace(self, shared={**self.shared, **more}) if more else self

    def next_pair(self, cameras: Sequence[str]) -> tuple[str, str, int] | None:
        """Which two to sweep next, and how many pictures they share: the weakest link of the best chain of all.

        None when the pairs that share enough connect all cameras.
        """
        joined = {name: {name} for name in cameras}
        pairs = [(self.shared.get(pair, 0), pair) for pair in combinations(sorted(cameras), 2)]
        for count, (a, b) in sorted(pairs, key=lambda one: -one[0]):
            if joined[a] is joined[b]:
                continue
            if count < PAIR_ENOUGH:
                return a, b, count
            joined[a] |= joined[b]
            for name in joined[b]:
                joined[name] = joined[a]
        return None

    def missing(self, camera: str) -> tuple[int, ...]:
        """Cells of a camera's picture that the ball has not been in."""
        counts = self.counts.get(camera, (0,) * CELL_COUNT)
        return tuple(cell for cell, count in enumerate(counts) if count < self.enough)


FIRST_BOARD: Final = Board("chessboard", 6, 9, 0.03)
"""Default board; coverage does not depend on its spacing."""


@dataclass(frozen=True, slots=True)
class BoardGuide:
    """The board to search for, and its coverage."""

    board: Board = FIRST_BOARD
    cells: SweptCells = field(default_factory=lambda: SweptCells(enough=1))
    """Coverage cells; the board is searched while they are active."""
    pictures: Mapping[str, int] = field(default_factory=dict)
    """Number of pictures with the whole board, by camera."""

    def with_board(self, camera: str, cells: Iterable[int]) -> BoardGuide:
        """Copy with one more picture of the board, with points in these cells of a camera."""
        covered = self.cells
        for cell in cells:
            covered = covered.with_ball(camera, cell)
        return replace(self, cells=covered, pictures={**self.pictures, camera: self.pictures.get(camera, 0) + 1})

    def emptied(self) -> BoardGuide:
        """Copy with empty counts."""
        return BoardGuide(self.board, SweptCells(self.cells.active, enough=1))


CORNER_NAMES: Final = tuple(CORNERS)


@dataclass(frozen=True, slots=True)
class TableMark:
    """One click."""

    camera: str
    corner: str
    u_px: float
    v_px: float

    @property
    def number(self) -> int:
        """Number of the corner, from 1, shown beside it."""
        return CORNER_NAMES.index(self.corner) + 1


@dataclass(frozen=True, slots=True)
class TableClicks:
    """All clicks in their order."""

    active: bool = False
    """Whether clicks on a picture mark corners."""
    corner: str = CORNER_NAMES[0]
    """Corner that the next click marks."""
    marks: tuple[TableMark, ...] = ()

    def clicked(self, camera: str, u_px: float, v_px: float) -> TableClicks:
        """Copy with a click added or moved; the camera's next missing corner is chosen."""
        others = tuple(one for one in self.marks if (one.camera, one.corner) != (camera, self.corner))
        marks = (*others, TableMark(camera, self.corner, u_px, v_px))
        there = {one.corner for one in marks if one.camera == camera}
        at = CORNER_NAMES.index(self.corner)
        later = (*CORNER_NAMES[at + 1 :], *CORNER_NAMES[:at])
        corner = next((name for name in later if name not in there), self.corner)
        return replace(self, marks=marks, corner=corner)

    def undone(self) -> TableClicks:
        """Copy without the last click, whose corner is chosen again."""
        if not self.marks:
            return self
        return replace(self, marks=self.marks[:-1], corner=self.marks[-1].corner)

    def of(self, camera: str) -> dict[str, tuple[float, float]]:
        """Corner -> pixel in one camera's picture."""
        return {one.corner: (one.u_px, one.v_px) for one in self.marks if one.camera == camera}
