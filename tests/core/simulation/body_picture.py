"""The whole picture of a scene with moving bodies at one instant, without the memory and the tiles of the camera."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.bodies.parts import MovingBodies, probe_bodies
from core.simulation.bodies.shading import BEFORE_NET, FAR_COVER, NEAR_COVER, light_and_rest, posed_bodies, posed_parts
from core.simulation.bodies.tile_updates import TILE_PX, draw_tile, near_tile
from core.simulation.bodies.view import make_scene_view
from core.simulation.scenes.scene import SceneConfig
from core.simulation.scenes.shading import UNTOUCHED, Moving, pixel_seen

Array = NDArray[np.float64]


class BodyPicture:
    """Draws the bodies of a scene over the static picture `maps` of a camera."""

    def __init__(
        self, camera: Camera, scene: SceneConfig, bodies: MovingBodies | None, maps: NDArray[np.float32]
    ) -> None:
        self._camera, self._bodies = camera, bodies
        self._scene = make_scene_view(camera, scene, maps, None if bodies is None else bodies.parts)

    def draw(self, t_s: float, ball_m: float) -> None:
        """Pose the bodies at `t_s`; those beyond camera z `ball_m` are behind the ball."""
        if self._bodies is None:
            return
        probe = probe_bodies(self._camera, self._bodies, np.array([t_s]))
        _draw_all(self._scene, probe.ends[0], probe.circles[0], ball_m)

    def render(self, ball: tuple[float, ...], racket: tuple[float, ...], see_racket: bool, out: Array) -> None:
        """Log intensity of every pixel with ball and robot's racket, written to `out` (pixels,)."""
        _render(self._scene, Moving(ball, racket, True, True, see_racket), out)


@njit(error_model="numpy")
def _draw_all(scene, ends, circles, ball_m):
    posed, layers = posed_bodies(ends, circles), scene.layers
    posed_parts(scene, posed)
    wide, high = (scene.width_px + TILE_PX - 1) // TILE_PX, (scene.height_px + TILE_PX - 1) // TILE_PX
    for pixel in range(len(layers)):
        layers[pixel, NEAR_COVER] = layers[pixel, FAR_COVER] = layers[pixel, BEFORE_NET] = 0.0
    for tile in range(wide * high):
        near = False
        for index in range(len(circles)):
            near = near or near_tile(circles[index], tile % wide, tile // wide)
        if near:
            draw_tile(tile, scene, posed, ball_m)


@njit(error_model="numpy")
def _render(scene, moving, out):
    for pixel in range(len(out)):
        light, rest = light_and_rest(pixel_seen(scene.maps, pixel), scene.layers, pixel, scene.numbers, moving)
        out[pixel] = rest if light == UNTOUCHED else math.log(light)
