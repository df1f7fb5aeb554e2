"""How sure a prediction is: a tube round the path, and ellipses of the bounce and the hit; two standard deviations."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from core.rally.history.rally_picture import UncertaintyEllipse

Array = NDArray[np.float64]
TUBE_RGB: Final = (90, 200, 255)
SIGMAS: Final = 2.0
RINGS: Final = 20
"""A tube always has this many, so that its handle is reused."""
CORNERS: Final = 12
ELLIPSES: Final = 2
"""Of the bounce and of the hit."""
ELLIPSE_CORNERS: Final = 32


class UncertaintyActor:
    """The tube in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._tube = scene.add_mesh_simple(
            name,
            np.zeros((RINGS * CORNERS, 3), np.float32),
            tube_faces(),
            color=TUBE_RGB,
            opacity=0.28,
            side="double",
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
        )
        flat = np.zeros((ELLIPSE_CORNERS, 2, 3), np.float32)
        self._ellipses = [
            scene.add_line_segments(f"{name}/ellipse-{number}", flat, TUBE_RGB, thickness=0.005, visible=False)
            for number in range(ELLIPSES)
        ]

    def show(self, ps_world_m: Array, sigmas_m: Array, spreads: tuple[UncertaintyEllipse, ...]) -> None:
        """Along a path (N, 3) with its standard deviations (N, 3); fewer than two points hide the tube."""
        for handle, spread in zip(self._ellipses, (*spreads, None, None), strict=False):
            handle.visible = spread is not None
            if spread is not None:
                handle.points = ellipse(spread)
        self._tube.visible = len(ps_world_m) > 1
        if len(ps_world_m) > 1:
            self._tube.vertices = tube_vertices(ps_world_m, sigmas_m)


def ellipse(spread: UncertaintyEllipse) -> NDArray[np.float32]:
    """(ELLIPSE_CORNERS, 2, 3) segments, SIGMAS standard deviations from the middle."""
    angles = np.linspace(0, 2 * np.pi, ELLIPSE_CORNERS + 1)
    points = spread.centre + SIGMAS * np.column_stack([np.cos(angles), np.sin(angles)]) @ spread.axes
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def tube_faces() -> NDArray[np.uint32]:
    """(2 (RINGS - 1) CORNERS, 3) triangles between neighbouring rings."""
    ring, corner = np.meshgrid(np.arange(RINGS - 1), np.arange(CORNERS), indexing="ij")
    here, beside = ring * CORNERS + corner, ring * CORNERS + (corner + 1) % CORNERS
    lower = np.stack([here, beside, here + CORNERS], axis=-1)
    upper = np.stack([beside, beside + CORNERS, here + CORNERS], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]).astype(np.uint32)


def tube_vertices(ps_world_m: Array, sigmas_m: Array) -> NDArray[np.float32]:
    """(RINGS CORNERS, 3): ellipses across the path, SIGMAS standard deviations wide and high on each side."""
    rows, at = np.arange(len(ps_world_m)), np.linspace(0, len(ps_world_m) - 1, RINGS)
    ps, sigmas = (np.stack([np.interp(at, rows, a[:, k]) for k in range(3)], axis=1) for a in (ps_world_m, sigmas_m))
    along = np.gradient(ps, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    side = np.cross(along, (0.0, 0.0, 1.0))
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    up = np.cross(side, along)
    half = [SIGMAS * np.sqrt(((axis * sigmas) ** 2).sum(axis=1))[:, None, None] for axis in (side, up)]
    angles = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)[None, :, None]
    rings = ps[:, None] + half[0] * np.cos(angles) * side[:, None] + half[1] * np.sin(angles) * up[:, None]
    return rings.reshape(-1, 3).astype(np.float32)
