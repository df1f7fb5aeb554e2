"""What one camera sees of a scene with moving bodies, and remembers of them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.simulation.bodies.parts import PART_COLUMNS, BodyProbes, MovingBodies, probe_bodies, steps_of_fastest
from core.simulation.bodies.shading import (
    SceneView,
)
from core.simulation.bodies.tile_updates import REST_PX, UPDATE_PX, TileUpdates
from core.simulation.scenes.block_view import view_numbers
from core.simulation.scenes.scene import SceneConfig

Array = NDArray[np.float64]


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
