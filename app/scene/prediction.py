"""What the chain expects: the flight before and after the bounce, the bounce, the hitting plane."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

Array = NDArray[np.float64]
BEFORE_RGB: Final = (255, 214, 10)
AFTER_RGB: Final = (30, 225, 110)
PLANE_RGB: Final = (120, 170, 255)
PATH_POINTS: Final = 48
"""Paths are always resampled to this many points, so that their handles are reused."""
PLANE_WIDTH_M: Final = 1.6
PLANE_HEIGHT_M: Final = 0.7
ABOVE_M: Final = 0.002


class PredictionActors:
    """The predictions in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, root: str, *, plane_x_m: float) -> None:
        flat = np.zeros((PATH_POINTS - 1, 2, 3), np.float32)
        self._before = scene.add_line_segments(f"{root}/before", flat, BEFORE_RGB, thickness=0.006, visible=False)
        self._after = scene.add_line_segments(f"{root}/after", flat, AFTER_RGB, thickness=0.008, visible=False)
        self._bounce = scene.add_line_segments(
            f"{root}/bounce", ring(0.035), BEFORE_RGB, thickness=0.008, visible=False
        )
        self._hit = scene.add_icosphere(f"{root}/hit", 0.022, AFTER_RGB, opacity=0.55, visible=False, cast_shadow=False)
        corners = np.array([[0, -0.5, 0.0], [0, 0.5, 0.0], [0, 0.5, 1.0], [0, -0.5, 1.0]])
        corners = corners * [1, PLANE_WIDTH_M, PLANE_HEIGHT_M] + [plane_x_m, 0.0, -0.05]
        edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)
        self._plane = scene.add_line_segments(f"{root}/plane", edges, PLANE_RGB, thickness=0.004)

    def show(self, before: Array, after: Array, bounce: Array | None, hit: Array | None, *, plane: bool) -> None:
        """The paths (N, 3), empty to hide them; the points (3,)."""
        for handle, path in ((self._before, before), (self._after, after)):
            handle.visible = len(path) > 1
            if len(path) > 1:
                handle.points = segments(path, PATH_POINTS)
        self._bounce.visible = bounce is not None
        if bounce is not None:
            self._bounce.position = (bounce[0], bounce[1], ABOVE_M)
        self._hit.visible = hit is not None
        if hit is not None:
            self._hit.position = hit
        self._plane.visible = plane


def segments(path: Array, points: int) -> NDArray[np.float32]:
    """(points - 1, 2, 3) segments along a path (N, 3), N >= 2, evenly spaced in its rows."""
    at = np.linspace(0, len(path) - 1, points)
    rows = np.arange(len(path))
    even = np.stack([np.interp(at, rows, path[:, k]) for k in range(3)], axis=1)
    return np.stack([even[:-1], even[1:]], axis=1).astype(np.float32)


def ring(radius_m: float, corners: int = 24) -> NDArray[np.float32]:
    """(corners, 2, 3) segments of a level circle round the origin."""
    angles = np.linspace(0, 2 * np.pi, corners + 1)
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1) * radius_m
    return np.stack([circle[:-1], circle[1:]], axis=1).astype(np.float32)
