"""Moving bodies in the pictures of a colour camera: layers in red, green and blue, drawn again where they move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.jit import njit
from core.simulation.bodies.parts import REFLECTANCE, TEXTURE, BodyProbes, MovingBodies, probe_bodies, steps_of_fastest
from core.simulation.bodies.person import Clothes
from core.simulation.bodies.shading import PARTS_IN_PIXEL, POSED_COLUMNS, posed_parts
from core.simulation.bodies.tile_updates import TILE_PX, draw_tile, mark_moved
from core.simulation.bodies.view import TileUpdates, edge_and_ambient
from core.simulation.frames.colours import CLOTH_TINTS, SKIN_TINT, Tint, tinted
from core.simulation.scenes.block_view import view_numbers
from core.simulation.scenes.scene import SceneConfig

Array = NDArray[np.float64]

LOOK_PX: Final = 0.1
"""A part that has moved less since it was drawn last is left as it is. A blade that only turns is up to 20 levels wrong
then, in single pixels (measured)."""
PROBES: Final = 9


class FrameBodies:
    """The bodies of a scene to one colour camera with the static pictures `maps` of its three colours."""

    def __init__(
        self, camera: Camera, scene: SceneConfig, bodies: MovingBodies, maps: Sequence[NDArray[np.float32]]
    ) -> None:
        size = camera.sensor
        self._camera, self._bodies, self._maps = camera, bodies, maps
        self._shape = (size.width_px, size.height_px)
        self._wide = -(-size.width_px // TILE_PX)
        self._parts = [tinted_parts(bodies.parts, channel) for channel in range(3)]
        self.layers = [np.zeros_like(channel) for channel in maps]
        """Per colour, see `core.simulation.bodies.shading`."""
        self._scene = edge_and_ambient(camera, scene)
        self._view = view_numbers(camera)
        self._looks = TileUpdates.none_yet(self._shape, len(bodies.parts))

    def instants(self, start_us: int, end_us: int, step_px: float) -> int:
        """How many steps of at most `step_px` the fastest part makes in [start, end]."""
        return steps_of_fastest(self.probe(np.linspace(start_us, end_us, PROBES)), step_px)

    def probe(self, t_us: Array) -> BodyProbes:
        """Where the bodies are at the times `t_us` (N,)."""
        return probe_bodies(self._camera, self._bodies, t_us * 1e-6)

    def cover(self, probes: BodyProbes) -> NDArray[np.bool_]:
        """(height, width): where a body may be at one of the probes."""
        width, height = self._shape
        near = TileUpdates.none_yet(self._shape, len(self._parts[0]))
        for circles in probes.circles:
            mark_moved(circles, near.looked, 0.0, self._shape, near.marks, near.tiles, near.listed)
        tiles = near.marks.reshape(-1, self._wide)
        return tiles.repeat(TILE_PX, axis=0)[:height].repeat(TILE_PX, axis=1)[:, :width]

    def look(self, probes: BodyProbes, which: int, ball_m: float, boxes: NDArray[np.int64]) -> None:
        """Draw what has moved, and the boxes (K, 4): what is before the ball at `ball_m` may change there."""
        looks = self._looks
        mark_moved(probes.circles[which], looks.looked, LOOK_PX, self._shape, looks.marks, looks.tiles, looks.listed)
        for x0, y0, x1, y1 in boxes.tolist():
            for row in range(y0 // TILE_PX, -(-y1 // TILE_PX)):
                self._list(row * self._wide + np.arange(x0 // TILE_PX, -(-x1 // TILE_PX)))
        count, looks.listed[0] = int(looks.listed[0]), 0
        tiles = looks.tiles[:count]
        looks.marks[tiles] = False
        for parts, maps, layers in zip(self._parts, self._maps, self.layers, strict=True):
            _draw(
                tiles, self._shape, maps, layers, probes.ends[which], probes.circles[which], parts, self._scene,
                ball_m, self._view,
            )  # fmt: skip

    def _list(self, tiles: NDArray[np.int64]) -> None:
        looks = self._looks
        new = tiles[~looks.marks[tiles]]
        count = int(looks.listed[0])
        looks.tiles[count : count + len(new)], looks.marks[new] = new, True
        looks.listed[0] = count + len(new)


def tinted_parts(parts: Array, channel: int) -> Array:
    """The parts in red (0), green (1) or blue (2) light: skin, and shirts and shorts of a few colours."""
    skin, coloured = Clothes(shirt=0.0, shorts=0.0).skin, parts.copy()
    for row in coloured:
        grey = row[REFLECTANCE]
        tint: Tint = (1.0, 1.0, 1.0)
        if grey == skin:
            tint = SKIN_TINT
        elif row[TEXTURE] > 0:
            tint = CLOTH_TINTS[round(100 * grey) % len(CLOTH_TINTS)]
        row[REFLECTANCE] = tinted(grey, tint, channel)
    return coloured


@njit(error_model="numpy")
def _draw(tiles, shape, maps, layers, ends, circles, parts, scene, ball_m, view):
    here, found = np.empty(len(parts), np.int64), np.empty((PARTS_IN_PIXEL, 3))
    posed = np.empty((len(parts), POSED_COLUMNS))
    posed_parts(ends, parts, scene[0], posed)
    for tile in tiles:
        draw_tile(tile, shape, maps, layers, posed, circles, here, found, scene, ball_m, view)
