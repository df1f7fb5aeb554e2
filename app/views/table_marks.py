"""The table's corners that were clicked in a picture, numbered, and the outline that fits them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from app.pictures.canvas import Canvas
from app.pictures.palette import PaletteIndex
from app.state.table_clicks import TableClicks
from core.cameras import Camera
from core.cameras.calibration.table_corners import CORNERS
from core.cameras.calibration.table_pose import clicks_of, find_table_pose
from core.errors import CalibrationError

RADIUS_PX = 8
OUTLINE = ("robot-left", "robot-right", "opponent-right", "opponent-left")
NET = ("net-left", "post-left", "post-right", "net-right")
EDGE_POINTS = 24
"""Of each edge: a lens bends lines."""


def draw_table_clicks(canvas: Canvas, name: str, lens: Camera | None, clicks: TableClicks) -> None:
    """Marks with the numbers of their corners; and, once they fix a pose, table and net as they then are."""
    marks = [mark for mark in clicks.marks if mark.camera == name]
    if lens is not None and marks:
        try:
            pose = find_table_pose(name, lens, clicks_of(clicks.of(name)))
        except CalibrationError:
            pass  # the panel says why there is none
        else:
            for corners, closed in ((OUTLINE, True), (NET, False)):
                points = pose.camera.project(_edges(corners, closed=closed))
                if np.isfinite(points).all():
                    canvas.draw_polygon(points, PaletteIndex.EPIPOLAR, closed=closed)
    for mark in marks:
        canvas.draw_broken_ring(
            mark.u_px, mark.v_px, RADIUS_PX * canvas.across, PaletteIndex.LABEL, thickness=canvas.across
        )
        away = 1.4 * RADIUS_PX * canvas.across / canvas.scale
        canvas.write(mark.u_px + away, mark.v_px - away / 2, str(mark.number), PaletteIndex.LABEL)


def _edges(corners: tuple[str, ...], *, closed: bool) -> np.ndarray:
    """(N, 3) points along the lines from corner to corner."""
    ps = np.array([CORNERS[corner] for corner in corners])
    ends = np.vstack([ps, ps[:1]]) if closed else ps
    share = np.linspace(0, 1, EDGE_POINTS)[:, None]
    return np.vstack([a + share * (b - a) for a, b in pairwise(ends)])
