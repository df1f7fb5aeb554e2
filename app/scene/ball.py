"""The ball with its halo, its trail, the truth beside it, and the rays that found it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]
BALL_RGB: Final = (255, 140, 30)
TRAIL_RGB: Final = (255, 90, 10)
TRUTH_RGB: Final = (40, 220, 220)
RAY_RGB: Final = (255, 200, 60)
HALO_M: Final = 0.05
"""A ball is two pixels in a view of the whole table; its halo is seen."""
TRAIL_POINTS: Final = 64
"""The trail always has this many points, so that its handle is reused."""


class BallActors:
    """Everything that follows the ball in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, root: str, cameras: int) -> None:
        self._ball = scene.add_icosphere(f"{root}/ball", BALL_RADIUS_M, BALL_RGB, visible=False)
        self._halo = scene.add_icosphere(
            f"{root}/halo", HALO_M, BALL_RGB, opacity=0.25, visible=False, cast_shadow=False
        )
        self._truth = scene.add_icosphere(
            f"{root}/truth", 1.12 * BALL_RADIUS_M, TRUTH_RGB, wireframe=True, visible=False, subdivisions=2
        )
        flat = np.zeros((TRAIL_POINTS - 1, 2, 3), np.float32)
        self._trail = scene.add_line_segments(f"{root}/trail", flat, TRAIL_RGB, thickness=0.008, visible=False)
        rays = np.zeros((max(1, cameras), 2, 3), np.float32)
        self._rays = scene.add_line_segments(f"{root}/rays", rays, RAY_RGB, thickness=0.003, visible=False)

    def show_ball(self, p_world_m: Array | None) -> None:
        """The ball as it was measured; None hides it."""
        for handle in (self._ball, self._halo):
            handle.visible = p_world_m is not None
            if p_world_m is not None:
                handle.position = p_world_m

    def show_truth(self, p_world_m: Array | None) -> None:
        """The true ball; None hides it."""
        self._truth.visible = p_world_m is not None
        if p_world_m is not None:
            self._truth.position = p_world_m

    def show_trail(self, ps_world_m: Array) -> None:
        """(N, 3) where the ball was, oldest first; fewer than two points hide it."""
        self._trail.visible = len(ps_world_m) > 1
        if len(ps_world_m) > 1:
            points = ps_world_m[-TRAIL_POINTS:]
            points = np.concatenate([np.repeat(points[:1], TRAIL_POINTS - len(points), axis=0), points])
            self._trail.points = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)

    def show_rays(self, rays_world_m: Sequence[tuple[Array, Array]]) -> None:
        """From each camera that sees the ball to where it is seen; none hide them."""
        self._rays.visible = bool(rays_world_m)
        if rays_world_m:
            filled = [*rays_world_m, *[rays_world_m[0]] * (len(self._rays.points) - len(rays_world_m))]
            self._rays.points = np.array(filled, np.float32)
