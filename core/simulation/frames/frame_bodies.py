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
from core.simulation.bodies.shading import SceneView, posed_bodies, posed_parts
from core.simulation.bodies.tile_updates import TILE_PX, TileUpdates, draw_tile, mark_moved
from core.simulation.frames.colours import CLOTH_TINTS, SKIN_TINT, Tint, tinted

Array = NDArray[np.float64]

LOOK_PX: Final = 0.1
"""A part that has moved less since it was drawn last is left as it is. A blade that only turns is up to 20 levels wrong
then, in single pixels (measured)."""
PROBES: Final = 9


class FrameBodies:
    """The bodies of a scene to one colour camera, drawn in the `scenes` of its three colours."""

    def __init__(self, camera: Camera, bodies: MovingBodies, scenes: Sequence[SceneView]) -> None:
        self._camera, self._bodies, self._scenes = camera, bodies, scenes
        self._updates = self._none_yet()

    def _none_yet(self) -> TileUpdates:
        size = self._camera.sensor
        return TileUpdates.none_yet(size.width_px, size.height_px, len(self._bodies.parts))

    def instants(self, start_us: int, end_us: int, step_px: float) -> int:
        """How many steps of at most `step_px` the fastest part makes in [start, end]."""
        return steps_of_fastest(self.probe(np.linspace(start_us, end_us, PROBES)), step_px)

    def probe(self, t_us: Array) -> BodyProbes:
        """Where the bodies are at the times `t_us` (N,)."""
        return probe_bodies(self._camera, self._bodies, t_us * 1e-6)

    def cover(self, probes: BodyProbes) -> NDArray[np.bool_]:
        """(height, width): where a body may be at one of the probes."""
        size, near = self._camera.sensor, self._none_yet()
        for circles in probes.circles:
            mark_moved(circles, 0.0, near)
        tiles = near.marks.reshape(near.rows, near.columns)
        return tiles.repeat(TILE_PX, axis=0)[: size.height_px].repeat(TILE_PX, axis=1)[:, : size.width_px]

    def look(self, probes: BodyProbes, which: int, ball_m: float, boxes: NDArray[np.int64]) -> None:
        """Draw what has moved, and the boxes (K, 4): what is before the ball at `ball_m` may change there."""
        updates = self._updates
        mark_moved(probes.circles[which], LOOK_PX, updates)
        for x0, y0, x1, y1 in boxes.tolist():
            for row in range(y0 // TILE_PX, -(-y1 // TILE_PX)):
                self._list(row * updates.columns + np.arange(x0 // TILE_PX, -(-x1 // TILE_PX)))
        count, updates.listed[0] = int(updates.listed[0]), 0
        tiles = updates.tiles[:count]
        updates.marks[tiles] = False
        for scene in self._scenes:
            _draw(tiles, scene, probes.ends[which], probes.circles[which], ball_m)

    def _list(self, tiles: NDArray[np.int64]) -> None:
        updates = self._updates
        new = tiles[~updates.marks[tiles]]
        count = int(updates.listed[0])
        updates.tiles[count : count + len(new)], updates.marks[new] = new, True
        updates.listed[0] = count + len(new)


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
def _draw(tiles, scene, ends, circles, ball_m):
    posed = posed_bodies(ends, circles)
    posed_parts(scene, posed)
    for tile in tiles:
        draw_tile(tile, scene, posed, ball_m)
