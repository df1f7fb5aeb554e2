"""A camera's projection for compiled code: the arithmetic of `Camera.project`, one point at a time."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.lens_kernel import CX, CY, FOLD, FX, FY, distort_point
from core.geometry import invert_transform
from core.jit import njit

BOX_MARGIN_PX = 1.5
"""Beyond half an edge, for the curvature of the outline between its points and for rounding."""


class LensNumbers(NamedTuple):
    """What a projection needs to know of a camera."""

    R: NDArray[np.float64]
    """(3, 3) rotation from the world to the camera."""
    t: NDArray[np.float64]
    """(3,) position of the world's origin in the camera's frame."""
    camera_m: NDArray[np.float64]
    """(3,) the camera in the world."""
    focal_px: tuple[float, float]
    row: NDArray[np.float64]
    """Focal lengths, centre and distortion, as `core.cameras.lens_kernel` wants them."""
    size_px: tuple[int, int]


@functools.lru_cache(maxsize=64)
def lens_of(camera: Camera) -> LensNumbers:
    """The numbers of a camera."""
    T = invert_transform(camera.T_world_camera)
    return LensNumbers(
        np.ascontiguousarray(T[:3, :3]),
        np.ascontiguousarray(T[:3, 3]),
        np.ascontiguousarray(camera.position_world_m),
        (float(camera.K[0, 0]), float(camera.K[1, 1])),
        camera.lens_row(),
        (camera.sensor.width_px, camera.sensor.height_px),
    )


@njit(error_model="numpy")
def to_camera(lens, x, y, z):
    """A world point in the camera's frame."""
    R, t = lens.R, lens.t
    return (
        x * R[0, 0] + y * R[0, 1] + z * R[0, 2] + t[0],
        x * R[1, 0] + y * R[1, 1] + z * R[1, 2] + t[1],
        x * R[2, 0] + y * R[2, 1] + z * R[2, 2] + t[2],
    )


@njit(error_model="numpy")
def project_from_camera(lens, x, y, z):
    """The distorted pixel of a point in the camera's frame; nan where `Camera.project` has nan."""
    row = lens.row
    if not (z > 1e-9 and math.hypot(x, y) < row[FOLD] * z):
        return math.nan, math.nan
    u, v = distort_point(x / z, y / z, row)
    return u * row[FX] + row[CX], v * row[FY] + row[CY]


@njit(error_model="numpy")
def box_round(points, margin_px, size_px, out):
    """Write the box round an outline (K, 2), a little wider: first column, first row, one past the last; 0 off it."""
    low_u = low_v = math.inf
    high_u = high_v = -math.inf
    out[:] = 0
    for index in range(len(points)):
        u, v = points[index, 0], points[index, 1]
        if not (math.isfinite(u) and math.isfinite(v)):
            return
        low_u, high_u = min(low_u, u), max(high_u, u)
        low_v, high_v = min(low_v, v), max(high_v, v)
    widen = 0.05 * max(high_u - low_u, high_v - low_v) + margin_px + BOX_MARGIN_PX
    if not (high_u + widen > 0 and high_v + widen > 0 and low_u - widen < size_px[0] and low_v - widen < size_px[1]):
        return
    x0, y0 = max(math.floor(low_u - widen), 0), max(math.floor(low_v - widen), 0)
    x1, y1 = min(math.ceil(high_u + widen) + 1, size_px[0]), min(math.ceil(high_v + widen) + 1, size_px[1])
    if x1 > x0 and y1 > y0:
        out[0], out[1], out[2], out[3] = x0, y0, x1, y1


@njit(error_model="numpy")
def boxes_round(outlines, margin_px, size_px, out):
    """Write the box round each outline of (N, K, 2) to `out` (N, 4)."""
    for index in range(len(outlines)):
        box_round(outlines[index], margin_px, size_px, out[index])
