"""Compiled triangulation: the point nearest to the rays of all cameras, its reprojection residual and covariance."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.lens_kernel import CX, CY, FOLD, FX, FY, distort_point, slopes_at, undistort_point
from core.jit import njit

Array = NDArray[np.float64]

PARALLEL: Final = 1e-8
"""Determinant of the normal equations (sin^2 of the angle between two rays) below which rays do not meet."""


@njit
def invert_symmetric(a: Array, out: Array) -> bool:
    """Inverse of a symmetric (3, 3); false if it is singular."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c01 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c02 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    determinant = a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02
    if not determinant > PARALLEL:
        return False
    out[0, 0], out[1, 0], out[2, 0] = c00 / determinant, c01 / determinant, c02 / determinant
    out[0, 1] = (a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]) / determinant
    out[1, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]) / determinant
    out[2, 1] = (a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]) / determinant
    out[0, 2] = (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]) / determinant
    out[1, 2] = (a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]) / determinant
    out[2, 2] = (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]) / determinant
    return True


@njit
def _add_noise(x: float, y: float, depth: float, R: Array, lens: Array, spread_px: Array, noise: Array) -> None:
    """Add to `noise` (3, 3) what pixel noise in one camera moves its ray by, at a distance `depth` along it.

    `spread_px` (2, 2) is a root of the noise's covariance: each column a step of the pixel.
    """
    norm = math.sqrt(x * x + y * y + 1)
    xx, xy, yx, yy = slopes_at(x, y, lens)
    determinant = xx * yy - xy * yx
    # Derivative of the pinhole coordinates by the pixel, then of the unit direction by the pinhole coordinates.
    by_u = (yy / determinant / lens[FX], -yx / determinant / lens[FX])
    by_v = (-xy / determinant / lens[FY], xx / determinant / lens[FY])
    for step in range(2):
        du, dv = spread_px[0, step], spread_px[1, step]
        dx, dy = by_u[0] * du + by_v[0] * dv, by_u[1] * du + by_v[1] * dv
        along = (x * dx + y * dy) / (norm * norm)
        cx, cy, cz = (dx - along * x) / norm, (dy - along * y) / norm, -along / norm
        for i in range(3):
            move_i = R[i, 0] * cx + R[i, 1] * cy + R[i, 2] * cz
            for j in range(3):
                move_j = R[j, 0] * cx + R[j, 1] * cy + R[j, 2] * cz
                noise[i, j] += depth**2 * move_i * move_j


@njit
def _reprojection_px2(p: Array, u: float, v: float, centre: Array, R: Array, lens: Array) -> float:
    """Squared distance of a pixel from the projection of `p`; nan if it is not in front of the camera."""
    x, y, z = p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]
    zc = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
    if not zc > 1e-9:
        return math.nan
    xc = (R[0, 0] * x + R[1, 0] * y + R[2, 0] * z) / zc
    yc = (R[0, 1] * x + R[1, 1] * y + R[2, 1] * z) / zc
    if not math.hypot(xc, yc) < lens[FOLD]:
        return math.nan
    xd, yd = distort_point(xc, yc, lens)
    return (xd * lens[FX] + lens[CX] - u) ** 2 + (yd * lens[FY] + lens[CY] - v) ** 2


@njit
def triangulate_rows(
    uvs: Array, lenses: Array, centres: Array, Rs: Array, spreads_px: Array, ps: Array, residuals: Array, covs: Array
) -> None:
    """Fill points (N, 3), residuals (N,) and covariances (N, 3, 3) of pixels (N, C, 2); nan where there is no point.

    `spreads_px` (N, C, 2, 2): a root of each pixel's covariance.

    Args:
        uvs: (N, C, 2) pixels; nan where a camera has none.
        lenses: (C, L) as `CameraArrays` holds them.
        centres: (C, 3) places of the cameras in the world, m.
        Rs: (C, 3, 3) rotations from camera to world.
        spreads_px: (N, C, 2, 2) a root of each pixel's covariance.
        ps: (N, 3) output: points in the world, m.
        residuals: (N,) output: rms distance of the pixels from the projected point, px.
        covs: (N, 3, 3) output, m^2.
    """
    cameras = len(lenses)
    xys, rays = np.empty((cameras, 2)), np.empty((cameras, 3))
    inverse = np.empty((3, 3))
    for row in range(len(uvs)):
        ps[row], residuals[row], covs[row] = math.nan, math.nan, math.nan
        normal, right, noise = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
        seen = 0
        for c in range(cameras):
            x, y = undistort_point(uvs[row, c, 0], uvs[row, c, 1], lenses[c])
            xys[c, 0], xys[c, 1] = x, y
            if math.isnan(x):
                continue
            seen += 1
            norm = math.sqrt(x * x + y * y + 1)
            for i in range(3):
                rays[c, i] = (Rs[c, i, 0] * x + Rs[c, i, 1] * y + Rs[c, i, 2]) / norm
            for i in range(3):
                for j in range(3):
                    # I - r r': takes what is along the ray out, so the sum is minimal where the distances to the rays
                    # are.
                    across = (1.0 if i == j else 0.0) - rays[c, i] * rays[c, j]
                    normal[i, j] += across
                    right[i] += across * centres[c, j]
        if seen < 2 or not invert_symmetric(normal, inverse):
            continue
        p = inverse @ right
        squares = 0.0
        for c in range(cameras):
            if math.isnan(xys[c, 0]):
                continue
            squares += _reprojection_px2(p, uvs[row, c, 0], uvs[row, c, 1], centres[c], Rs[c], lenses[c])
            depth = 0.0
            for i in range(3):
                depth += (p[i] - centres[c, i]) * rays[c, i]
            _add_noise(xys[c, 0], xys[c, 1], depth, Rs[c], lenses[c], spreads_px[row, c], noise)
        if math.isnan(squares):
            continue
        ps[row], residuals[row] = p, math.sqrt(squares / seen)
        covs[row] = inverse @ noise @ inverse
