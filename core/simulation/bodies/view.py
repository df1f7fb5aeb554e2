"""What one camera remembers of the moving bodies, and what its kernels need to know of them in a block."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.simulation.bodies.looks import LOOK_PX, REST_PX, TILE_PX
from core.simulation.bodies.parts import PART_COLUMNS, BodyProbes, MovingBodies, probe_bodies
from core.simulation.scene import SceneConfig

PROBES: Final = 11
"""Instants in a block between which bodies move evenly: in a millisecond a swing bends by 10 um."""
NOWHERE: Final = -1e6
"""A circle that no part was ever at."""


class BodyView:
    """The bodies to one camera. Without bodies all arrays are empty."""

    def __init__(self, camera: Camera, scene: SceneConfig, bodies: MovingBodies | None) -> None:
        size = camera.sensor
        pixels = size.width_px * size.height_px if bodies is not None else 0
        tiles = -(-size.width_px // TILE_PX) * -(-size.height_px // TILE_PX) if bodies is not None else 0
        self._camera, self._bodies = camera, bodies
        self.parts = np.empty((0, PART_COLUMNS)) if bodies is None else bodies.parts
        self.scene = (scene.edge_px / math.sqrt(camera.K[0, 0] * camera.K[1, 1]), scene.ambient)
        self.layers: NDArray[np.float32] = np.zeros((pixels, 8), np.float32)
        self._looked = np.full((len(self.parts), 2, 3), NOWHERE)
        self._looked[:, :, 2] = -1.0
        self._marks, self._tiles = np.zeros(tiles, np.bool_), np.zeros(tiles, np.int64)
        self._listed, self._tile_us = np.zeros(1, np.int64), np.full(tiles, -1.0)

    @property
    def looks(self) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        """Circles at each part's last look, then the tiles to look at, see `core.simulation.bodies.looks`."""
        return self._looked, self._marks, self._tiles, self._listed, self._tile_us

    def probe(self, start_us: int, end_us: int) -> BodyProbes:
        """The bodies at `PROBES` instants of a block."""
        if self._bodies is None:
            return BodyProbes(np.empty((PROBES, 0, 2, 3)), np.empty((PROBES, 0, 2, 3)))
        return probe_bodies(self._camera, self._bodies, np.linspace(start_us, end_us, PROBES) * 1e-6)

    def substeps(self, probes: BodyProbes) -> int:
        """How many looks the fastest part needs in a block; 0 if nothing has moved since the last look."""
        if self._bodies is None:
            return 0
        circles = probes.circles
        if np.abs(circles - self._looked).max() < REST_PX:
            return 0
        there = (circles[..., 2] >= 0).all(axis=(0, 2))
        moved = np.abs(np.diff(circles[:, there], axis=0))
        return max(1, math.ceil(float(moved.max()) * (PROBES - 1) / LOOK_PX)) if moved.size else 1
