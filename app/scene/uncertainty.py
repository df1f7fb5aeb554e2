"""How sure a prediction is: a tube round the path, and ellipses of the bounce and the hit; two standard deviations."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from core.history.rally_picture import UncertaintyEllipse

Array = NDArray[np.float64]
TUBE_RGB: Final = (0, 190, 255)
SIGMAS: Final = 2.0
RINGS: Final = 20
"""A tube always has this many, so that its handle is reused."""
CORNERS: Final = 12
ELLIPSES: Final = 2
"""Number of ellipses: of the bounce and of the hit."""
ELLIPSE_CORNERS: Final = 32


def _circle(corners: int) -> Array:
    """(corners, 2) points of a circle, not closed."""
    angles = np.arange(corners) * (2 * np.pi / corners)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


_CIRCLE: Final = _circle(CORNERS)
_ELLIPSE: Final = np.concatenate([_circle(ELLIPSE_CORNERS), _circle(ELLIPSE_CORNERS)[:1]])


class UncertaintyActor:
    """The tube in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._tube = scene.add_mesh_simple(
            name,
            np.zeros((RINGS * CORNERS, 3), np.float32),
            tube_faces(),
            color=TUBE_RGB,
            opacity=0.30,
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
    points = spread.centre + SIGMAS * _ELLIPSE @ spread.axes
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
    ps, sigmas = _rows_for_rings(ps_world_m), _rows_for_rings(sigmas_m)
    along = np.empty_like(ps)
    along[1:-1], along[0], along[-1] = ps[2:] - ps[:-2], ps[1] - ps[0], ps[-1] - ps[-2]
    along /= np.maximum(np.sqrt((along * along).sum(axis=1, keepdims=True)), 1e-9)
    side = np.stack([along[:, 1], -along[:, 0], np.zeros(RINGS)], axis=1)
    side /= np.maximum(np.hypot(along[:, 0], along[:, 1])[:, None], 1e-9)
    up = np.stack(
        [side[:, 1] * along[:, 2], -side[:, 0] * along[:, 2], side[:, 0] * along[:, 1] - side[:, 1] * along[:, 0]],
        axis=1,
    )
    half = [SIGMAS * np.sqrt(((axis * sigmas) ** 2).sum(axis=1))[:, None, None] for axis in (side, up)]
    cos, sin = _CIRCLE[None, :, :1], _CIRCLE[None, :, 1:]
    rings = ps[:, None] + half[0] * cos * side[:, None] + half[1] * sin * up[:, None]
    return rings.reshape(-1, 3).astype(np.float32)


def _rows_for_rings(values: Array) -> Array:
    """(RINGS, 3) of values (N, 3) along a path."""
    if len(values) == RINGS:
        return values
    rows, at = np.arange(len(values)), np.linspace(0, len(values) - 1, RINGS)
    return np.stack([np.interp(at, rows, values[:, k]) for k in range(3)], axis=1)
