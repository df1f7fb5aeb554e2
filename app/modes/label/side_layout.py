"""Where the small pictures in Label stand: below the large one, or beside it in a wide window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MAIN_WIDTH_PX: Final = 1280
"""Width of the large picture on the sheet."""
LEAST_WIDTH_PX: Final = 240
"""Width on the sheet below which a ball in a small picture is no longer seen."""
MAX_COLUMNS: Final = 4
GAP_PX: Final = 12
USUAL_ASPECT: Final = 1.4
"""Width over height of the middle of a window of 1280x720."""


@dataclass(frozen=True, slots=True)
class SideLayout:
    """Places of the small pictures, in pixels of the sheet."""

    width_px: int
    """Width of each picture."""
    beside: bool
    """Whether they stand in a column at the right of the large picture; else in rows below it."""
    columns: int
    """Pictures in a row."""


def choose_side_layout(pictures: int, side_ratio: float, base_px: float, aspect: float) -> SideLayout:
    """The layout that leaves the large picture largest in a middle of this width over height.

    `side_ratio` is height over width of a small picture, `base_px` the height of the large picture with the line
    and the strip below it. The small ones take what the large one cannot use, and no less than `LEAST_WIDTH_PX` each.
    """
    rows_below, beside = _below(pictures, side_ratio, base_px, aspect), _beside(pictures, side_ratio, base_px, aspect)
    height_below = base_px + -(-pictures // rows_below.columns) * (rows_below.width_px * side_ratio + GAP_PX)
    scale_below = min(aspect / MAIN_WIDTH_PX, 1 / height_below)
    scale_beside = min(aspect / (MAIN_WIDTH_PX + GAP_PX + beside.width_px), 1 / base_px)
    return beside if scale_beside > scale_below else rows_below


def _below(pictures: int, side_ratio: float, base_px: float, aspect: float) -> SideLayout:
    columns = min(max(pictures, 2), MAX_COLUMNS)
    rows = -(-pictures // columns)
    free_px = MAIN_WIDTH_PX / aspect - base_px - rows * GAP_PX
    widest = (MAIN_WIDTH_PX - (columns - 1) * GAP_PX) // columns
    return SideLayout(round(min(max(free_px / rows / side_ratio, LEAST_WIDTH_PX), widest)), False, columns)


def _beside(pictures: int, side_ratio: float, base_px: float, aspect: float) -> SideLayout:
    widest = ((base_px + GAP_PX) / pictures - GAP_PX) / side_ratio
    free_px = base_px * aspect - MAIN_WIDTH_PX - GAP_PX
    return SideLayout(max(8, round(min(max(free_px, LEAST_WIDTH_PX), widest))), True, 1)
