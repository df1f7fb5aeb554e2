"""What one camera sees of a scene with moving bodies, and remembers of them; and the whole picture at one instant."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.bodies.parts import PART_COLUMNS, BodyProbes, MovingBodies, probe_bodies, steps_of_fastest
from core.simulation.bodies.shading import (
    BEFORE_NET,
    FAR_COVER,
    NEAR_COVER,
    SceneView,
    light_and_rest,
    posed_bodies,
    posed_parts,
)
from core.simulation.bodies.tile_updates import REST_PX, TILE_PX, UPDATE_PX, TileUpdates, draw_tile, near_tile
from core.simulation.scenes.block_view import view_numbers
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
        """Log intensity of every pixel with ball and robot's racket, written to `out` (pixels,).

        Args:
            ball: its row of shading numbers.
            racket: its row.
            see_racket: whether there is a racket.
            out: (pixels,) output.
        """
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


PROBES: Final = 11
"""Instants in a block between which bodies move evenly: in a millisecond a swing bends by 10 um."""


def make_scene_view(
    camera: Camera, scene: SceneConfig, maps: NDArray[np.float32], parts: NDArray[np.float64] | None
) -> SceneView:
    """A scene with the static picture `maps` and the parts (P, PART_COLUMNS) of its bodies, not yet drawn.

    Args:
        camera: lens, pose and sensor.
        scene: light and edges.
        maps: (pixels, columns) the static picture.
        parts: (P, PART_COLUMNS) of the bodies; None: there are none.
    """
    layers = np.zeros((0 if parts is None else len(maps), 8), np.float32)
    parts = np.empty((0, PART_COLUMNS)) if parts is None else parts
    edge_per_m = scene.edge_px / math.sqrt(camera.K[0, 0] * camera.K[1, 1])
    width_px, height_px = camera.sensor.width_px, camera.sensor.height_px
    return SceneView(width_px, height_px, maps, layers, view_numbers(camera), parts, edge_per_m, scene.ambient)


class BodyView:
    """The bodies to one camera. Without bodies all arrays are empty."""

    def __init__(self, camera: Camera, bodies: MovingBodies | None) -> None:
        self._camera, self._bodies = camera, bodies
        size, parts = camera.sensor, 0 if bodies is None else len(bodies.parts)
        self.updates = TileUpdates.none_yet(size.width_px, size.height_px, parts)

    def probe(self, start_us: int, end_us: int) -> BodyProbes:
        """The bodies at `PROBES` instants of a block."""
        if self._bodies is None:
            return BodyProbes(np.empty((PROBES, 0, 2, 3)), np.empty((PROBES, 0, 2, 3)))
        return probe_bodies(self._camera, self._bodies, np.linspace(start_us, end_us, PROBES) * 1e-6)

    def substeps(self, probes: BodyProbes) -> int:
        """How many looks the fastest part needs in a block; 0 if nothing has moved since the last look."""
        if self._bodies is None:
            return 0
        if np.abs(probes.circles - self.updates.looked).max() < REST_PX:
            return 0
        return steps_of_fastest(probes, UPDATE_PX)
