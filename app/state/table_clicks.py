"""Clicked corners of the table in the cameras' pictures, as one frozen value."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from core.cameras.calibration.table_corners import CORNERS

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
