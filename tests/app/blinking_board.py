"""A recording of a dot board that blinks before event cameras, in poses that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from core.cameras import Camera
from core.cameras.calibration import Board
from core.events import Events, SensorSize
from core.geometry import make_transform, transform_points
from core.recordings import RecordingWriter
from tests.board_painter import BoardPainter

BOARD = Board("dots", 5, 7, 0.03)
BLINK_MS = 250
SENSOR = SensorSize(400, 300)
CAMERA = Camera(SENSOR, np.array([[350.0, 0, 202.0], [0, 352.0, 148.0], [0, 0, 1]]), np.zeros(5), np.eye(4))
POSES_M = ((-0.1, -0.05, 0.5), (0.1, -0.05, 0.5), (-0.1, 0.06, 0.5), (0.1, 0.06, 0.5))
"""The board's middle in each; a quarter of the picture is never covered by any one of them."""


def pose(middle_m: tuple[float, float, float]) -> np.ndarray:
    """(4, 4) of a board that is tilted by 20 degrees."""
    R = Rotation.from_euler("y", 20, degrees=True).as_matrix()
    return make_transform(R, np.array(middle_m) - R @ BOARD.points_m.mean(axis=0))


def points_px(middle_m: tuple[float, float, float]) -> np.ndarray:
    """(35, 2) where the dots are seen."""
    return CAMERA.project(transform_points(pose(middle_m), BOARD.points_m))


def blink(path: Path, poses_m=POSES_M, *, noise: int = 200) -> None:
    """Each pose blinks once in a quarter of a second before "left"; "right" sees so many events a millisecond only."""
    rng, painter = np.random.default_rng(0), BoardPainter(CAMERA)
    with RecordingWriter(path, {"left": SENSOR, "right": SENSOR}) as writer:
        for number, middle_m in enumerate(poses_m):
            # As many events as the logarithm of the brightness rises above the dark screen's.
            expected = 3 * np.log1p(painter.draw(BOARD, pose(middle_m)) / 25.5)
            counts = np.floor(expected + rng.uniform(size=expected.shape)).astype(int)
            v, u = np.nonzero(counts)
            v, u = np.repeat(v, counts[v, u]), np.repeat(u, counts[v, u])
            start_us = 1000 * BLINK_MS * number
            t_us = np.sort(start_us + 50_000 + rng.integers(0, 4000, len(u)))
            writer.append("left", Events.from_columns(t_us, u, v, np.ones(len(u), bool), SENSOR))
            t_us = np.sort(start_us + rng.integers(0, 1000 * BLINK_MS, noise * BLINK_MS))
            u, v = rng.integers(0, SENSOR.width_px, len(t_us)), rng.integers(0, SENSOR.height_px, len(t_us))
            writer.append("right", Events.from_columns(t_us, u, v, rng.integers(0, 2, len(t_us)) > 0, SENSOR))
        writer.extend_duration(1000 * BLINK_MS * len(poses_m))
