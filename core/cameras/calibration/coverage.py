"""Which parts of a picture something has been in, for a calibration: a lens is known where points were.

For a board also its tilts and distances, what is still missing, and a picture of all that.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras.calibration.board import Board, board_pose
from core.cameras.calibration.residual_picture import BELOW, CHART, DOT, GRID, PAPER, REJECTED, TOP, WIDTH
from core.cameras.camera import Camera
from core.events import SensorSize

if TYPE_CHECKING:
    from core.cameras.calibration.intrinsics import BoardView  # which asks here what a lens is still missing

CELLS_ACROSS: Final = 8
CELLS_DOWN: Final = 6
CELL_COUNT: Final = CELLS_ACROSS * CELLS_DOWN


def cells_of(uvs_px: ArrayLike, sensor: SensorSize) -> NDArray[np.int64]:
    """(N,) the cell of each pixel (N, 2), row by row from the upper left; those beside the picture in the nearest."""
    uvs = np.asarray(uvs_px, np.float64).reshape(-1, 2)
    share = (uvs + 0.5) / (sensor.width_px, sensor.height_px) * (CELLS_ACROSS, CELLS_DOWN)
    column, row = np.clip(np.nan_to_num(share), 0, (CELLS_ACROSS - 1, CELLS_DOWN - 1)).astype(np.int64).T
    return np.asarray(row * CELLS_ACROSS + column, np.int64)


def cell_box(cell: int, sensor: SensorSize) -> tuple[float, float, float, float]:
    """Left, top, right and bottom edge of a cell in sensor pixels."""
    row, column = divmod(cell, CELLS_ACROSS)
    width, height = sensor.width_px / CELLS_ACROSS, sensor.height_px / CELLS_DOWN
    left, top = column * width - 0.5, row * height - 0.5
    return left, top, left + width, top + height


def coverage(uvs_px: ArrayLike, sensor: SensorSize) -> float:
    """Share of the picture's cells that hold one of the pixels (N, 2)."""
    return len(np.unique(cells_of(uvs_px, sensor))) / CELL_COUNT


Array = NDArray[np.float64]
PICTURES_WANTED: Final = 15
TILT_WANTED_DEG: Final = 20.0
"""To both sides about both axes: less, and focal length and distance are told apart by little."""
DISTANCES_WANTED: Final = 1.3
"""The farthest by the nearest."""
ROWS: Final = ("upper", "middle", "lower")
COLUMNS: Final = ("left", "middle", "right")

NEAREST_M, FARTHEST_M = 0.05, 15.0
"""Distances of a board whose points can be found."""
SPACING_UNITS = ((10.0, "centimetres"), (1000.0, "metres"), (1e-3, "micrometres"))
"""What the board's distance is multiplied by if its spacing was in that unit."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardCover:
    """Positions and sizes of the board in N pictures that show all of it."""

    cells: NDArray[np.int64]
    """(48,) pictures with a point of the board in each cell, row by row from the upper left."""
    tilts_deg: Array
    """(N, 2) of the board against the picture's plane: about the vertical axis (above 0 if the board's right edge, as
    seen, is the farther one) and about the horizontal one (if its lower edge is)."""
    distances_m: Array
    """(N,) of the board's middle from the camera, along the optical axis."""


def board_cover(views: Sequence[BoardView], board: Board, camera: Camera) -> BoardCover:
    """Where the board was in those pictures, as the lens that they gave sees it."""
    cells = np.zeros(CELL_COUNT, np.int64)
    tilts, distances = [], []
    for view in views:
        cells[np.unique(cells_of(view.uvs_px, camera.sensor))] += 1
        R, t = board_pose(board, view.uvs_px, camera)
        x, y, z = R[:, 2] * np.sign(R[2, 2] or 1.0)  # the board's normal, away from the camera
        tilts.append(np.degrees((np.arctan2(-x, z), np.arctan2(-y, z))))
        distances.append(float((R @ board.points_m.mean(axis=0) + t)[2]))
    return BoardCover(cells, np.array(tilts, np.float64).reshape(-1, 2), np.array(distances, np.float64))


def odd_spacing(cover: BoardCover) -> str | None:
    """A line if the board was so near or so far that its spacing must be in another unit; None otherwise."""
    if not len(cover.distances_m):
        return None
    away_m = float(np.median(cover.distances_m))
    if NEAREST_M <= away_m <= FARTHEST_M:
        return None
    likely = [unit for factor, unit in SPACING_UNITS if NEAREST_M <= away_m * factor <= FARTHEST_M]
    asked = f": is --spacing-mm in {likely[0]}?" if likely else ""
    return f"with this spacing the board would be {away_m:.3g} m away{asked}"


def missing_for_lens(cover: BoardCover) -> tuple[str, ...]:
    """What more pictures should show, in plain words and most important first; nothing if all was seen."""
    advice: list[str] = []
    empty = [ninth for ninth, share in _empty_shares(np.flatnonzero(cover.cells == 0).tolist()) if share > 0.5]
    if empty:
        advice.append(f"the board {_listed([ninth_words(ninth) for ninth in empty])} of the picture")
    if len(cover.tilts_deg):
        for column, words in enumerate((("its right edge", "its left edge"), ("its lower edge", "its upper edge"))):
            most, least = cover.tilts_deg[:, column].max(), cover.tilts_deg[:, column].min()
            wanted = [word for word, seen in zip(words, (most, -least), strict=True) if seen < TILT_WANTED_DEG]
            if wanted:
                advice.append(f"the board with {_listed(wanted)} farther away, by {TILT_WANTED_DEG:.0f} to 40 degrees")
        if cover.distances_m.max() < DISTANCES_WANTED * cover.distances_m.min():
            advice.append("other distances, near and far")
    if (count := len(cover.tilts_deg)) < PICTURES_WANTED:
        advice.append(f"more pictures: {PICTURES_WANTED} or more, here are {count}")
    return tuple(advice)


def emptiest_ninth(cells: Iterable[int]) -> tuple[int, int]:
    """Row and column, 0 to 2, of the ninth of the picture with most of some cells; there has to be one."""
    parts = Counter(_ninth(cell) for cell in cells)
    return max(sorted(parts), key=lambda part: parts[part])


def ninth_words(ninth: tuple[int, int]) -> str:
    """Where in the picture that is."""
    row, column = ninth
    return "in the middle" if ninth == (1, 1) else f"at the {ROWS[row]} {COLUMNS[column]}"


def _ninth(cell: int) -> tuple[int, int]:
    return 3 * (cell // CELLS_ACROSS) // CELLS_DOWN, 3 * (cell % CELLS_ACROSS) // CELLS_ACROSS


def _empty_shares(empty: Sequence[int]) -> list[tuple[tuple[int, int], float]]:
    """Share of empty cells in each ninth of the picture."""
    whole, of_them = Counter(map(_ninth, range(CELL_COUNT))), Counter(map(_ninth, empty))
    return [(ninth, of_them[ninth] / count) for ninth, count in sorted(whole.items())]


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


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
