"""Two cameras on one ball: the epipolar curve of a click, and how well two labels of one instant agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera, StereoRig, ball_circles

Array = NDArray[np.float64]
NEAREST_M, FARTHEST_M = 0.3, 8.0
"""Depths along a ray that a ball at a table can have."""


@dataclass(frozen=True, slots=True, eq=False)
class StereoCheck:
    """N pairs of labels of the same instants; nan where one is missing or no ray exists."""

    p_world_m: Array
    """(N, 3) the point that both pictures agree on best."""
    residual_px: Array
    """(N,) distance of the labels from that point's projections, both cameras together. Errors along the epipolar line
    move the point and leave no residual: nothing can see them in two views."""
    expected_r_px: Array
    """(N, 2) radius of a ball at that point in either camera: of the circle with the area of its outline."""


def epipolar_curve(here: Camera, uv_px: ArrayLike, there: Camera, *, points: int = 192) -> Array:
    """(M, 2) pixels in camera `there` of the ray through `uv_px` in camera `here`, near to far.

    Points in front of both cameras within the sensor and a little around it; bent as the lens distorts. Empty if the
    ray cannot be seen.
    """
    ray = here.unproject(uv_px)
    if not np.isfinite(ray).all():
        return np.empty((0, 2))
    # Even in inverse depth, which is even in the picture.
    depths = 1.0 / np.linspace(1.0 / NEAREST_M, 1.0 / FARTHEST_M, points)
    curve = there.project(here.position_world_m + depths[:, None] * ray)
    width, height = there.sensor.width_px, there.sensor.height_px
    near = np.isfinite(curve).all(axis=1)
    near &= (np.abs(curve[:, 0] - width / 2) < width) & (np.abs(curve[:, 1] - height / 2) < height)
    return curve[near]


def check_stereo(first: Camera, uvs_first: ArrayLike, second: Camera, uvs_second: ArrayLike) -> StereoCheck:
    """Triangulate pairs of positions (N, 2) and compare them with the projections of the points found."""
    uvs = np.stack([np.atleast_2d(np.asarray(uv, np.float64)) for uv in (uvs_first, uvs_second)], axis=1)
    points = StereoRig({"first": first, "second": second}).triangulate(uvs)
    p = points.ps_world_m
    radii = [ball_circles(camera, p).r_px for camera in (first, second)]
    return StereoCheck(p, np.sqrt(2.0) * points.residuals_px, np.column_stack(radii))
