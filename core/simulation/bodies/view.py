"""What one camera remembers of the moving bodies, and what its kernels need to know of them in a block."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.simulation.bodies.parts import PART_COLUMNS, BodyProbes, MovingBodies, probe_bodies, steps_of_fastest
from core.simulation.bodies.tile_updates import REST_PX, TILE_PX, UPDATE_PX
from core.simulation.scenes.scene import SceneConfig

PROBES: Final = 11
"""Instants in a block between which bodies move evenly: in a millisecond a swing bends by 10 um."""
NOWHERE: Final = -1e6
"""A circle that no part was ever at."""


@dataclass(frozen=True, slots=True, eq=False)
class TileUpdates:
    """Which tiles of a picture have to be drawn again; `core.simulation.bodies.tile_updates` changes it in place."""

    looked: NDArray[np.float64]
    """(P, 2, 3) circles of every part at its last look."""
    marks: NDArray[np.bool_]
    """(tiles,) whether one is listed."""
    tiles: NDArray[np.int64]
    """(tiles,) room for the numbers of those that are listed."""
    listed: NDArray[np.int64]
    """(1,) how many are."""

    @staticmethod
    def none_yet(shape: tuple[int, int], parts: int) -> TileUpdates:
        """Nothing was ever looked at in a picture of so many columns and rows."""
        looked = np.full((parts, 2, 3), NOWHERE)
        looked[:, :, 2] = -1.0
        count = -(-shape[0] // TILE_PX) * -(-shape[1] // TILE_PX)
        return TileUpdates(looked, np.zeros(count, np.bool_), np.zeros(count, np.int64), np.zeros(1, np.int64))


def edge_and_ambient(camera: Camera, scene: SceneConfig) -> tuple[float, float]:
    """What the kernels need of a scene: width of an edge per metre of camera z, ambient share of the light."""
    return scene.edge_px / math.sqrt(camera.K[0, 0] * camera.K[1, 1]), scene.ambient


class BodyView:
    """The bodies to one camera. Without bodies all arrays are empty."""

    def __init__(self, camera: Camera, scene: SceneConfig, bodies: MovingBodies | None) -> None:
        shape = (camera.sensor.width_px, camera.sensor.height_px) if bodies is not None else (0, 0)
        self._camera, self._bodies = camera, bodies
        self.parts = np.empty((0, PART_COLUMNS)) if bodies is None else bodies.parts
        self.scene = edge_and_ambient(camera, scene)
        self.layers: NDArray[np.float32] = np.zeros((shape[0] * shape[1], 8), np.float32)
        self._looks = TileUpdates.none_yet(shape, len(self.parts))
        self._tile_us = np.full(len(self._looks.marks), -1.0)

    @property
    def looks(self) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        """Circles at each part's last look, then the tiles to look at, see `core.simulation.bodies.tile_updates`."""
        looks = self._looks
        return looks.looked, looks.marks, looks.tiles, looks.listed, self._tile_us

    def probe(self, start_us: int, end_us: int) -> BodyProbes:
        """The bodies at `PROBES` instants of a block."""
        if self._bodies is None:
            return BodyProbes(np.empty((PROBES, 0, 2, 3)), np.empty((PROBES, 0, 2, 3)))
        return probe_bodies(self._camera, self._bodies, np.linspace(start_us, end_us, PROBES) * 1e-6)

    def substeps(self, probes: BodyProbes) -> int:
        """How many looks the fastest part needs in a block; 0 if nothing has moved since the last look."""
        if self._bodies is None:
            return 0
        if np.abs(probes.circles - self._looks.looked).max() < REST_PX:
            return 0
        return steps_of_fastest(probes, UPDATE_PX)
