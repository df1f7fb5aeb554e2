"""Where balls are to land, and where past ones did, coloured by their case."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.prediction import ABOVE_M, ring
from core.history.rally_picture import LandingSpot
from core.physics.episode import Case

CASE_RGB: Final[dict[Case, tuple[int, int, int]]] = {
    Case.OWN_HALF: (255, 170, 0),
    Case.NET: (197, 90, 255),
    Case.OUT: (255, 40, 40),
    Case.RETURNED: (38, 230, 157),
    Case.MISSED: (127, 132, 145),
}
CASE_NAMES: Final[dict[Case, str]] = {
    Case.OWN_HALF: "own half",
    Case.NET: "net",
    Case.OUT: "out",
    Case.RETURNED: "returned",
    Case.MISSED: "missed",
}
TARGET_RGB: Final = (255, 255, 255)
SPOTS: Final = 500
"""Most landing points shown; the newest are kept."""
SPOT_ABOVE_M: Final = 0.018
"""Spots are discs that face the eye: lower, half of them would be in the table."""
REACH_M: Final = 4.0
"""A spot farther from the middle than this is not drawn."""


class LandingActors:
    """The target and the spots in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, root: str) -> None:
        rings = np.concatenate([ring(0.05), ring(0.10)])
        self._target = scene.add_line_segments(f"{root}/target", rings, TARGET_RGB, thickness=0.008, visible=False)
        nothing = np.zeros((1, 3), np.float32)
        self._spots = scene.add_point_cloud(
            f"{root}/spots", nothing, np.zeros((1, 3), np.uint8), point_size=0.03, point_shape="circle", visible=False
        )
        self._goal: NDArray[np.float64] | None = None
        self._shown: tuple[LandingSpot, ...] = ()

    def show(self, target: NDArray[np.float64] | None, spots: tuple[LandingSpot, ...]) -> None:
        """The target (2,), and the spots, oldest first."""
        self._target.visible = target is not None
        if target is not None and target is not self._goal:
            self._goal = target
            self._target.position = (target[0], target[1], 2 * ABOVE_M)
        if spots == self._shown:
            return
        self._shown = spots
        near = [spot for spot in spots[-SPOTS:] if max(abs(spot.x_m), abs(spot.y_m)) < REACH_M]
        self._spots.visible = bool(near)
        if near:
            self._spots.points = np.array([(spot.x_m, spot.y_m, SPOT_ABOVE_M) for spot in near], np.float32)
            self._spots.colors = np.array([CASE_RGB[spot.case] for spot in near], np.uint8)
