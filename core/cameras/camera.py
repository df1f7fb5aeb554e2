"""A calibrated camera: pinhole with OpenCV's five distortion coefficients, placed in the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras.distortion import distort, fold_radius, undistort
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import check_transform, invert_transform, transform_points

ABSURD: Final = 1e9
"""Pixels or coefficients: sums of their powers stay far from what a number can hold."""


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
        if not np.array_equal(self.K[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]], (0, 0, 0, 0, 1)):
            raise CalibrationError("K has a skew or a wrong last row", expected="0 0 1 below", got=self.K.tolist())
        if self.distortion.shape != (5,) or not np.isfinite(self.distortion).all():
            raise CalibrationError("distortion is wrong", expected="k1 k2 p1 p2 k3", got=self.distortion.tolist())
        check_transform(self.T_world_camera, where="T_world_camera")
        for what, numbers in (("K", self.K), ("distortion", self.distortion)):
            if np.abs(numbers).max() > ABSURD:
                raise CalibrationError(f"{what} of no camera", expected=f"below {ABSURD:g}", got=numbers.tolist())

    @property
    def position_world_m(self) -> NDArray[np.float64]:
        """The optical centre (3,)."""
        return self.T_world_camera[:3, 3]

    def to_camera(self, ps_world: ArrayLike) -> NDArray[np.float64]:
        """World points (N, 3) in the camera's frame."""
        return transform_points(invert_transform(self.T_world_camera), np.atleast_2d(ps_world))

    def project(self, ps_world: ArrayLike) -> NDArray[np.float64]:
        """Distorted pixel positions (N, 2) of world points (N, 3).

        nan for points behind the camera, and for points so far off the axis that the distortion polynomial has
        turned back there and would fold them into the picture.
        """
        return self.project_from_camera(self.to_camera(ps_world))

    def project_from_camera(self, ps_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """Like `project`, for points (N, 3) in the camera's frame."""
        uvs = np.full((len(ps_camera), 2), np.nan)
        z = ps_camera[:, 2]
        front = z > 1e-9
        front[front] &= np.hypot(ps_camera[front, 0], ps_camera[front, 1]) < fold_radius(self.distortion) * z[front]
        uvs[front] = self._to_pixels(distort(ps_camera[front, :2] / z[front, None], self.distortion))
        return uvs

    def undistort(self, uvs_px: ArrayLike) -> NDArray[np.float64]:
        """Pinhole coordinates x / z, y / z (N, 2) of distorted pixel positions (N, 2); nan where no ray leads there."""
        uvs = np.atleast_2d(np.asarray(uvs_px, np.float64))
        return undistort((uvs - self.K[:2, 2]) / np.diag(self.K)[:2], self.distortion)

    def unproject(self, uvs_px: ArrayLike) -> NDArray[np.float64]:
        """Unit directions (N, 3) in the world of the rays from `position_world_m` through pixels (N, 2)."""
        xys = self.undistort(uvs_px)
        rays_camera = np.column_stack([xys, np.ones(len(xys))])
        rays_camera /= np.linalg.norm(rays_camera, axis=1, keepdims=True)
        return rays_camera @ self.T_world_camera[:3, :3].T

    def _to_pixels(self, xys: NDArray[np.float64]) -> NDArray[np.float64]:
        return xys * np.diag(self.K)[:2] + self.K[:2, 2]
