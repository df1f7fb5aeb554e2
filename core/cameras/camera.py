"""A calibrated camera: OpenCV's pinhole or fisheye lens with its distortion, placed in the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras.distortion import (
    COEFFICIENTS,
    ORDER,
    LensModel,
    distort,
    distortion_slopes,
    fold_radius,
    lens_row,
    undistort,
)
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
    """As OpenCV orders them. Pinhole: (5,) k1 k2 p1 p2 k3, or (8,), (12,) or (14,). Fisheye: (4,) k1 k2 k3 k4."""
    T_world_camera: NDArray[np.float64]
    """(4, 4); the camera looks along its +z, x right, y down."""
    model: LensModel = "pinhole"
    """How rays become pixels. A fisheye lens is followed up to 90 degrees from its axis: farther off, there are no
    pinhole coordinates."""

    def __post_init__(self) -> None:
        if self.K.shape != (3, 3) or not (np.isfinite(self.K).all() and self.K[0, 0] > 0 and self.K[1, 1] > 0):
            raise CalibrationError("K is not a camera matrix", expected="(3, 3) with fx, fy > 0", got=self.K.tolist())
        if not np.array_equal(self.K[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]], (0, 0, 0, 0, 1)):
            raise CalibrationError("K has a skew or a wrong last row", expected="0 0 1 below", got=self.K.tolist())
        if self.model not in COEFFICIENTS:
            raise CalibrationError("no such lens model", expected=" or ".join(COEFFICIENTS), got=repr(self.model)[:80])
        fits = self.distortion.shape in [(count,) for count in COEFFICIENTS[self.model]]
        if not fits or not np.isfinite(self.distortion).all():
            raise CalibrationError("distortion is wrong", expected=ORDER[self.model], got=self.distortion.tolist())
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
        front[front] &= np.hypot(ps_camera[front, 0], ps_camera[front, 1]) < self._fold * z[front]
        uvs[front] = self._to_pixels(distort(ps_camera[front, :2] / z[front, None], self.distortion, self.model))
        return uvs

    def undistort(self, uvs_px: ArrayLike) -> NDArray[np.float64]:
        """Pinhole coordinates x / z, y / z (N, 2) of distorted pixel positions (N, 2); nan where no ray leads there."""
        uvs = np.atleast_2d(np.asarray(uvs_px, np.float64))
        return undistort((uvs - self.K[:2, 2]) / np.diag(self.K)[:2], self.distortion, self.model)

    def unproject(self, uvs_px: ArrayLike) -> NDArray[np.float64]:
        """Unit directions (N, 3) in the world of the rays from `position_world_m` through pixels (N, 2)."""
        xys = self.undistort(uvs_px)
        rays_camera = np.column_stack([xys, np.ones(len(xys))])
        rays_camera /= np.linalg.norm(rays_camera, axis=1, keepdims=True)
        return rays_camera @ self.T_world_camera[:3, :3].T

    def pixel_slopes(self, xys: ArrayLike) -> NDArray[np.float64]:
        """(N, 2, 2) pixels that the picture moves per unit of the pinhole coordinates (N, 2)."""
        slopes = distortion_slopes(np.atleast_2d(np.asarray(xys, np.float64)), self.distortion, self.model)
        return slopes * np.diag(self.K)[:2, None]

    def lens_row(self) -> NDArray[np.float64]:
        """The lens for compiled code, see `core.cameras.lens_kernel`."""
        return lens_row(self.K, self.distortion, self.model)

    @property
    def _fold(self) -> float:
        return fold_radius(self.distortion, self.model)

    def _to_pixels(self, xys: NDArray[np.float64]) -> NDArray[np.float64]:
        return xys * np.diag(self.K)[:2] + self.K[:2, 2]
