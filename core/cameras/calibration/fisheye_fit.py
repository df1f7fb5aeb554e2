"""A fisheye lens (Kannala-Brandt) from views of a board, by OpenCV's `fisheye.calibrate`, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.board import Board
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.events import SensorSize

Array = NDArray[np.float64]

FISHEYE_PARAMETERS: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
STOP: Final = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9)
FIRST_ANGLES_DEG: Final = (90.0, 60.0, 40.0)
"""First guesses: how far off the axis the corner of the picture sees. From a bad one OpenCV finds nothing."""
FLAGS: Final = tuple(
    getattr(cv2.fisheye if hasattr(cv2.fisheye, name) else cv2, name)
    for name in ("CALIB_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW", "CALIB_USE_INTRINSIC_GUESS")
)
"""OpenCV 4 has flags of their own for the fisheye; 5 has one set for all."""


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeFit:
    """A lens, its standard deviations and how well each view fits."""

    camera: Camera
    sigmas: dict[str, float]
    rms_px: Array
    """Per view."""
    total_rms_px: float


def fit_fisheye(views: Sequence[Array], board: Board, sensor: SensorSize) -> FisheyeFit:
    """The lens that explains the board's points (N, 2) of each view best.

    Raises:
        CalibrationError: if the pictures fix no such lens.
    """
    points = board.points_m[None]
    found = [one for angle in FIRST_ANGLES_DEG if (one := _calibrate(views, points, sensor, angle)) is not None]
    if not found:
        remedy = "tilt the board between the pictures, show it all over the picture, or fit a pinhole"
        raise CalibrationError("the pictures fix no fisheye lens", remedy=remedy)
    _, K, coefficients, rvecs, tvecs = min(found, key=lambda one: one[0])
    camera = Camera(sensor, np.asarray(K, np.float64), np.ravel(coefficients).astype(np.float64), np.eye(4), "fisheye")
    residuals: list[Array] = []
    information = np.zeros((8, 8))
    for view, rvec, tvec in zip(views, rvecs, tvecs, strict=True):
        seen, slopes = cv2.fisheye.projectPoints(
            points, np.ravel(rvec)[None], np.ravel(tvec)[None], camera.K, camera.distortion
        )
        residuals.append(view - np.asarray(seen, np.float64).reshape(-1, 2))
        lens, pose = slopes[:, :8], slopes[:, 8:14]  # fx fy cx cy k1 k2 k3 k4, then the turn and the shift
        information += lens.T @ lens - lens.T @ pose @ np.linalg.pinv(pose.T @ pose) @ pose.T @ lens
    squares = np.concatenate([residual.ravel() for residual in residuals]) ** 2
    freedom = max(1, len(squares) - 8 - 6 * len(views))
    deviations = np.sqrt(np.maximum(0.0, np.diag(np.linalg.pinv(information))) * squares.sum() / freedom)
    return FisheyeFit(
        camera,
        dict(zip(FISHEYE_PARAMETERS, deviations.tolist(), strict=True)),
        np.array([np.sqrt((residual**2).sum(axis=1).mean()) for residual in residuals]),
        float(np.sqrt(2 * squares.mean())),
    )


def _calibrate(
    views: Sequence[Array], points: Array, sensor: SensorSize, angle_deg: float
) -> tuple[float, Array, Array, Sequence[Array], Sequence[Array]] | None:
    """Error, K, coefficients and the poses of the board, from a first guess; None if OpenCV finds none."""
    size = (sensor.width_px, sensor.height_px)
    focal_px = 0.5 * float(np.hypot(*size)) / np.radians(angle_deg)
    K = np.array([[focal_px, 0, (size[0] - 1) / 2], [0, focal_px, (size[1] - 1) / 2], [0, 0, 1]], np.float64)
    try:
        rms, K, coefficients, rvecs, tvecs = cv2.fisheye.calibrate(
            [points] * len(views),
            [view[None] for view in views],
            size,
            K,
            np.zeros((4, 1)),
            flags=sum(FLAGS),
            criteria=STOP,
        )
    except cv2.error:
        return None
    numbers = np.concatenate([np.ravel(K), np.ravel(coefficients)])
    if not (np.isfinite(rms) and np.isfinite(numbers).all()):
        return None
    turns, moves = ([np.asarray(one, np.float64) for one in each] for each in (rvecs, tvecs))
    return float(rms), np.asarray(K, np.float64), np.asarray(coefficients, np.float64), turns, moves
