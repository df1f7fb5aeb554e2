"""A calibrated camera: pinhole with OpenCV's five distortion coefficients, placed in the world."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import check_transform, invert_transform, transform_points


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Intrinsics, distortion and pose of one camera. Pixel (0.0, 0.0) is the centre of the top left pixel."""

    sensor: SensorSize
    K: NDArray[np.float64]
    """(3, 3), pixels."""
    distortion: NDArray[np.float64]
    """(5,): k1 k2 p1 p2 k3 as OpenCV orders them."""
    T_world_camera: NDArray[np.float64]
    """(4, 4); the camera looks along its +z, x right, y down."""

    def __post_init__(self) -> None:
        if self.K.shape != (3, 3) or not (np.isfinite(self.K).all() and self.K[0, 0] > 0 and self.K[1, 1] > 0):
            raise CalibrationError("K is not a camera matrix", expected="(3, 3) with fx, fy > 0", got=self.K.tolist())
        if self.distortion.shape != (5,) or not np.isfinite(self.distortion).all():
            raise CalibrationError("distortion is wrong", expected="k1 k2 p1 p2 k3", got=self.distortion.tolist())
        check_transform(self.T_world_camera, where="T_world_camera")

    def project(self, ps_world: ArrayLike) -> NDArray[np.float64]:
        """Distorted pixel positions (N, 2) of world points (N, 3); nan for points behind the camera."""
        ps_camera = transform_points(invert_transform(self.T_world_camera), np.atleast_2d(ps_world))
        uvs = np.full((len(ps_camera), 2), np.nan)
        front = ps_camera[:, 2] > 1e-9
        if front.any():
            zeros = np.zeros(3)
            uvs[front] = cv2.projectPoints(ps_camera[front], zeros, zeros, self.K, self.distortion)[0].reshape(-1, 2)
        return uvs
