"""Where the ball was, as a line that is coloured by its speed."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.speed_colours import speed_line_colours

Array = NDArray[np.float64]

POINTS: Final = 72
"""The trail always has this many points, so that its handle is reused."""
THICKNESS_PX: Final = 5.0
SAME_COLOUR: Final = 6
"""Colours that differ by so many of 255 levels are not sent again."""


class TrailActor:
    """The trail in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        flat = np.zeros((POINTS - 1, 2, 3), np.float32)
        colours = np.zeros(flat.shape, np.uint8)
        self._colours = np.zeros((POINTS, 3), np.uint8)
        self._line = scene.add_line_segments(
            name, flat, colours, thickness=THICKNESS_PX, thickness_units="screen", visible=False
        )

    def show(self, ps_world_m: Array, speeds_mps: Array) -> None:
        """(N, 3) where the ball was, oldest first, and (N,) how fast; fewer than two points hide it."""
        self._line.visible = len(ps_world_m) > 1
        if len(ps_world_m) > 1:
            points, speeds = resampled(ps_world_m, speeds_mps, POINTS)
            self._line.points = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
            colours = speed_line_colours(speeds)
            if np.abs(colours.astype(np.int16) - self._colours).max() > SAME_COLOUR:
                self._colours = colours
                self._line.colors = np.stack([colours[:-1], colours[1:]], axis=1)


def resampled(ps_world_m: Array, speeds_mps: Array, points: int) -> tuple[Array, Array]:
    """(points, 3) and (points,) of a path (N, 3), N >= 2, with speeds (N,): rows of the path, both ends among them."""
    rows = (np.arange(points) * (len(ps_world_m) - 1) + (points - 1) // 2) // (points - 1)
    return ps_world_m[rows], speeds_mps[rows]
