"""Compiling the simulation before a ball is served: the first start on a machine spends half a minute on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Final

import numpy as np

from core.cameras import Camera
from core.events import SensorSize
from core.live.link.published import published_ball_rows
from core.live.worlds.world import SimulatedWorld, WorldConfig

SENSOR: Final = SensorSize(64, 48)
BLOCKS: Final = 120
"""Simulated time of 1.2 s: a ball flies into the racket, back over the net, and to the floor."""
BEFORE_RACKET_M: Final = np.array([0.5, 0.0, 0.1])
SPEED_MPS: Final = 6.0


def prepare_simulation(config: WorldConfig, cameras: Mapping[str, Camera]) -> None:
    """Play two balls in small pictures, so that all that a rally needs is compiled; nothing else comes of it."""
    small = {name: dataclasses.replace(camera, sensor=SENSOR, K=_scaled(camera)) for name, camera in cameras.items()}
    world = SimulatedWorld(config, small, seed=0)
    try:
        world.draw_serve(5.0)
        for number in range(BLOCKS):
            if number == BLOCKS // 4:
                start_m = world.rally.racket.p_m + BEFORE_RACKET_M
                world.serve(start_m, (-SPEED_MPS, 0.0, 0.0), (0.0, 0.0, 0.0))
            published_ball_rows(world.advance())
    finally:
        world.close()


def _scaled(camera: Camera) -> np.ndarray:
    """Camera matrix (3, 3) of the same view in the small picture."""
    scale = SENSOR.width_px / camera.sensor.width_px
    return camera.K * np.array([[scale], [scale], [1.0]])
