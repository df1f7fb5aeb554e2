"""Where a ball is in a picture: the outline of a sphere, and the centre and radius that stand for it.

The outline of a sphere is an ellipse (bent a little by distortion), and its centre is *not* the projection of the
sphere's centre: a 20 mm ball 1.5 m away and 30 degrees off the axis of an f = 1000 px lens is 0.14 px farther out.
Ground truth is what a detector sees: the centroid of the area inside the outline, and the radius of the circle of the
same area. For an ellipse these are its centre and the geometric mean of its half axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras.camera import Camera
from core.jit import njit
from core.table import BALL_RADIUS_M

OUTLINE_POINTS = 32
"""Trapezoid sums over a smooth closed curve converge faster than any power: 32 points are good to 1e-6 px."""


@dataclass(frozen=True, slots=True, eq=False)
class BallCircles:
    """N balls in the picture of one camera; nan for a ball that is not wholly in front of the camera."""

    u_px: NDArray[np.float64]
    v_px: NDArray[np.float64]
    r_px: NDArray[np.float64]


def ball_outline(
    camera: Camera, ps_world: ArrayLike, radius_m: float = BALL_RADIUS_M, points: int = OUTLINE_POINTS
) -> NDArray[np.float64]:
    """Pixel positions (N, points, 2) once round the outlines of spheres at `ps_world` (N, 3).

    Args:
        camera: the camera that sees them.
        ps_world: (N, 3) centres, m.
        radius_m: of the spheres.
        points: number of positions round each outline.
    """
    centres = camera.to_camera(ps_world)
    distance_squared = np.einsum("ij,ij->i", centres, centres)
    outside = (distance_squared > radius_m**2) & (centres[:, 2] > radius_m)
    centres = np.where(outside[:, None], centres, np.nan)
    with np.errstate(invalid="ignore"):
        shrink = 1.0 - radius_m**2 / distance_squared
        rim_radius = radius_m * np.sqrt(shrink)
    axis = centres / np.sqrt(distance_squared)[:, None]
    # The rays that touch the sphere do so on a circle across the line of sight; (a, b) spans its plane.
    a = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.9, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(axis, a)
    angle = np.arange(points) * (2 * np.pi / points)
    around = a[:, None] * np.cos(angle)[:, None] + b[:, None] * np.sin(angle)[:, None]
    rim = (centres * shrink[:, None])[:, None] + rim_radius[:, None, None] * around
    return camera.project_from_camera(rim.reshape(-1, 3)).reshape(len(centres), points, 2)


def ball_circles(camera: Camera, ps_world: ArrayLike, radius_m: float = BALL_RADIUS_M) -> BallCircles:
    """Centre and radius in the picture of spheres at `ps_world` (N, 3): centroid and equal-area radius."""
    outline = ball_outline(camera, ps_world, radius_m)
    circles = np.empty((3, len(outline)))
    for index, points in enumerate(outline):
        circles[:, index] = circle_round(points)
    return BallCircles(*circles)


def _slopes() -> NDArray[np.float64]:
    """What the values of a closed curve's other points say of its slope at one, in Fourier space: by their distance."""
    k = np.arange(1, OUTLINE_POINTS)
    slopes = np.pi / OUTLINE_POINTS * (-1.0) ** k / np.tan(np.pi * k / OUTLINE_POINTS)
    return np.concatenate([[0.0], slopes])


SLOPES = _slopes()


@njit(error_model="numpy")
def circle_round(points: NDArray[np.float64]) -> tuple[float, float, float]:
    """Centroid and equal-area radius of what an outline (OUTLINE_POINTS, 2) encloses, pixels: Green's theorem."""
    u = v = 0.0
    for k in range(OUTLINE_POINTS):
        u += points[k, 0] / OUTLINE_POINTS
        v += points[k, 1] / OUTLINE_POINTS
    twice_area = x_moment = y_moment = 0.0
    for k in range(OUTLINE_POINTS):
        dx = dy = 0.0
        for other in range(OUTLINE_POINTS):
            slope = SLOPES[(k - other) % OUTLINE_POINTS]
            dx += slope * (points[other, 0] - u)
            dy += slope * (points[other, 1] - v)
        x, y = points[k, 0] - u, points[k, 1] - v
        twice_area += x * dy - y * dx
        x_moment += x * x * dy
        y_moment += y * y * dx
    return u + x_moment / twice_area, v - y_moment / twice_area, math.sqrt(abs(0.5 * twice_area) / math.pi)
