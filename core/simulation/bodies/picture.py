"""The whole picture with bodies at one instant: for frames, and to check the looks at a few tiles against."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.bodies.parts import PART_COLUMNS, MovingBodies, probe_bodies
from core.simulation.bodies.shading import (
    BEFORE_NET,
    FAR_COVER,
    LOG_TOTAL,
    NEAR_COVER,
    PARTS_IN_PIXEL,
    POSED_COLUMNS,
    light_among,
    posed_parts,
)
from core.simulation.bodies.tile_updates import TILE_PX, draw_tile, near_tile
from core.simulation.bodies.view import edge_and_ambient
from core.simulation.scenes.background import LOG_LIGHT
from core.simulation.scenes.block_view import view_numbers
from core.simulation.scenes.scene import SceneConfig
from core.simulation.scenes.shading import UNTOUCHED, pixel_seen

Array = NDArray[np.float64]


class BodyPicture:
    """Draws the bodies of a scene over the static picture `maps` of a camera."""

    def __init__(
        self, camera: Camera, scene: SceneConfig, bodies: MovingBodies | None, maps: NDArray[np.float32]
    ) -> None:
        self._camera, self._bodies, self._maps = camera, bodies, maps
        self._scene = edge_and_ambient(camera, scene)
        self._parts = np.empty((0, PART_COLUMNS)) if bodies is None else bodies.parts
        self._layers = np.zeros((len(maps), 8), np.float32)
        self._view = view_numbers(camera)

    def draw(self, t_s: float, ball_m: float) -> None:
        """Pose the bodies at `t_s`; those beyond camera z `ball_m` are behind the ball."""
        if self._bodies is None:
            return
        probe, size = probe_bodies(self._camera, self._bodies, np.array([t_s])), self._camera.sensor
        posed = np.empty((len(self._parts), POSED_COLUMNS))
        posed_parts(probe.ends[0], self._parts, self._scene[0], posed)
        shape = (size.width_px, size.height_px)
        _draw_all(shape, self._maps, self._layers, posed, probe.circles[0], self._scene, ball_m, self._view)

    def render(self, ball: tuple[float, ...], racket: tuple[float, ...], see_racket: bool, out: Array) -> None:
        """Log intensity of every pixel with ball and robot's racket, written to `out` (pixels,)."""
        _render(self._maps, self._layers, self._view, ball, racket, see_racket, out)


@njit(error_model="numpy")
def _draw_all(shape, maps, layers, posed, circles, scene, ball_m, view):
    here, found = np.empty(len(posed), np.int64), np.empty((PARTS_IN_PIXEL, 3))
    wide, high = (shape[0] + TILE_PX - 1) // TILE_PX, (shape[1] + TILE_PX - 1) // TILE_PX
    for pixel in range(len(layers)):
        layers[pixel, NEAR_COVER] = layers[pixel, FAR_COVER] = layers[pixel, BEFORE_NET] = 0.0
    for tile in range(wide * high):
        near = False
        for index in range(len(posed)):
            near = near or near_tile(circles[index], tile % wide, tile // wide)
        if near:
            draw_tile(tile, shape, maps, layers, posed, circles, here, found, scene, ball_m, view)


@njit(error_model="numpy")
def _render(maps, layers, view, ball, racket, see_racket, out):
    for pixel in range(len(out)):
        seen = pixel_seen(maps, pixel)
        there = layers[pixel, NEAR_COVER] > 0.0 or layers[pixel, FAR_COVER] > 0.0
        light = light_among(seen, layers, pixel, view, ball, racket, True, True, see_racket)
        rest = float(layers[pixel, LOG_TOTAL]) if there else seen[LOG_LIGHT]
        out[pixel] = rest if light == UNTOUCHED else math.log(light)
