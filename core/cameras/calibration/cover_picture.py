"""Where a board has been, as a column of a residual picture: the cells of the picture, and the tilts."""

from __future__ import annotations

from typing import Final

from core.cameras.calibration.board_cover import TILT_WANTED_DEG, BoardCover
from core.cameras.calibration.coverage import cell_box
from core.cameras.calibration.residual_picture import BELOW, CHART, DOT, GRID, PAPER, REJECTED, TOP, WIDTH
from core.events import SensorSize

REACH_DEG: Final = 60.0
"""Range of the chart of tilts to each side; what is beyond is drawn on the rim."""
FULL: Final = 5
"""Pictures from which a cell is drawn as bright as can be."""
GAP: Final = 2.5


def cover_column(cover: BoardCover, sensor: SensorSize) -> str:
    """Elements of an SVG, `WIDTH` wide: the picture's cells with how many boards were there, red where none was."""
    scale = WIDTH / sensor.width_px
    height = scale * sensor.height_px
    covered = int((cover.cells > 0).sum())
    parts = [
        f"<text x='0' y='{TOP - 8}'>pictures with the board in each part: {covered} of {len(cover.cells)} parts</text>",
        f"<rect y='{TOP}' width='{WIDTH}' height='{height:.1f}' fill='{PAPER}' stroke='{GRID}'/>",
    ]
    for cell, count in enumerate(cover.cells.tolist()):
        left, top, right, bottom = ((edge + 0.5) * scale for edge in cell_box(cell, sensor))
        box = f"x='{left + GAP:.1f}' y='{TOP + top + GAP:.1f}' width='{right - left - 2 * GAP:.1f}'"
        box += f" height='{bottom - top - 2 * GAP:.1f}'"
        if count:
            parts.append(f"<rect {box} fill='{DOT}' fill-opacity='{0.15 + 0.6 * min(count, FULL) / FULL:.2f}'/>")
        else:
            parts.append(f"<rect {box} class='empty' fill='none' stroke='{REJECTED}'/>")
        x, y = (left + right) / 2, TOP + (top + bottom) / 2 + 4
        parts.append(f"<text x='{x:.1f}' y='{y:.1f}' text-anchor='middle'>{count}</text>")
    return "".join([*parts, *_tilts(cover, TOP + height + BELOW)])


def _tilts(cover: BoardCover, y0: float) -> list[str]:
    """A dot a picture: to the right with its right edge away, down with its lower edge away; the square is what is
    too little to both sides.
    """
    half = CHART / 2
    x0, wanted = half, half * TILT_WANTED_DEG / REACH_DEG
    parts = [
        f"<rect y='{y0:.1f}' width='{CHART}' height='{CHART}' fill='{PAPER}' stroke='{GRID}'/>",
        f"<rect x='{x0 - wanted:.1f}' y='{y0 + half - wanted:.1f}' width='{2 * wanted:.1f}' height='{2 * wanted:.1f}'"
        f" fill='none' stroke='{GRID}'/>",
    ]
    for across, down in (half * cover.tilts_deg / REACH_DEG).clip(-half, half).tolist():
        parts.append(f"<circle class='tilt' cx='{x0 + across:.1f}' cy='{y0 + half + down:.1f}' r='2.5' fill='{DOT}'/>")
    lines = [
        f"tilts, a dot a picture, to {REACH_DEG:.0f} degrees:",
        "right: the right edge is away; down: the lower one.",
        f"Wanted: dots beyond the square ({TILT_WANTED_DEG:.0f} degrees) on all sides.",
    ]
    if len(cover.distances_m):
        lines.append(f"Distance: {cover.distances_m.min():.2f} to {cover.distances_m.max():.2f} m.")
    parts += [f"<text x='{CHART + 14}' y='{y0 + 16 + 18 * at:.1f}'>{line}</text>" for at, line in enumerate(lines)]
    return parts
