"""What the chain expects: the flight before and after the bounce, the bounce, the hitting plane."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

Array = NDArray[np.float64]
BEFORE_RGB: Final = (176, 205, 255)
AFTER_RGB: Final = (0, 229, 255)
"""What is expected is cold, what was seen is warm: told apart without seeing red or green."""
PLANE_RGB: Final = (120, 150, 200)
PATH_POINTS: Final = 48
"""Paths are always resampled to this many points, so that their handles are reused."""
BEFORE_PX: Final = 2.5
AFTER_PX: Final = 4.0
PLANE_PX: Final = 1.2
BOUNCE_M: Final = 0.05
STILL_M: Final = 0.001
"""What is expected trembles by less from one prediction to the next; nobody would see it, so it is not sent."""
PLANE_WIDTH_M: Final = 1.6
PLANE_HEIGHT_M: Final = 0.7
ABOVE_M: Final = 0.002


class PredictionActors:
    """The predictions in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, root: str, *, plane_x_m: float) -> None:
        flat = np.zeros((PATH_POINTS - 1, 2, 3), np.float32)
        self._before, self._after = (
            scene.add_line_segments(f"{root}/{name}", flat, rgb, thickness=px, thickness_units="screen", visible=False)
            for name, rgb, px in (("before", BEFORE_RGB, BEFORE_PX), ("after", AFTER_RGB, AFTER_PX))
        )
        self._bounce = scene.add_line_segments(
            f"{root}/bounce", ring(BOUNCE_M), AFTER_RGB, thickness=0.010, visible=False
        )
        self._hit = scene.add_icosphere(f"{root}/hit", 0.026, AFTER_RGB, opacity=0.8, visible=False, cast_shadow=False)
        self._paths: list[Array | None] = [None, None]
        self._bounces: Array | None = None
        self._hits: Array | None = None
        """Shown now: pictures of neighbouring moments share their values, and what did not change is not sent."""
        corners = np.array([[0, -0.5, 0.0], [0, 0.5, 0.0], [0, 0.5, 1.0], [0, -0.5, 1.0]])
        corners = corners * [1, PLANE_WIDTH_M, PLANE_HEIGHT_M] + [plane_x_m, 0.0, -0.05]
        edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)
        self._plane = scene.add_line_segments(
            f"{root}/plane", edges, PLANE_RGB, thickness=PLANE_PX, thickness_units="screen"
        )

    def show(self, before: Array, after: Array, bounce: Array | None, hit: Array | None, *, plane: bool) -> None:
        """The paths (N, 3), empty to hide them; the points (3,)."""
        for number, (handle, path) in enumerate(((self._before, before), (self._after, after))):
            handle.visible = len(path) > 1
            if len(path) > 1 and path is not self._paths[number]:
                self._paths[number] = path
                handle.points = segments(path, PATH_POINTS)
        self._bounce.visible = bounce is not None
        if bounce is not None and _moved(bounce, self._bounces):
            self._bounces = bounce
            self._bounce.position = (bounce[0], bounce[1], ABOVE_M)
        self._hit.visible = hit is not None
        if hit is not None and _moved(hit, self._hits):
            self._hits = hit
            self._hit.position = hit
        self._plane.visible = plane


def _moved(p: Array, before: Array | None) -> bool:
    return before is None or (p is not before and float(np.abs(p - before).max()) > STILL_M)


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
