"""Compiled: the point that fits the pixels of three cameras or more best, each weighted by its covariance."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras.lens_kernel import CX, CY, FOLD, FX, FY, distort_point, slopes_at
from core.cameras.stereo_kernel import invert_symmetric
from core.jit import njit

Array = NDArray[np.float64]
ROUNDS: Final = 3
"""Gauss-Newton steps from the point nearest to the rays: the third moves it by less than a micrometre."""


class RigArrays(NamedTuple):
    """The C cameras of a rig: lenses, centres (C, 3) in the world, rotations (C, 3, 3) from world to camera."""

    lenses: Array
    centres: Array
    Rs: Array


class CameraArrays(NamedTuple):
    """One camera of a rig: lens, centre (3,) in the world, rotation (3, 3) whose columns are its axes in the world."""

    lens: Array
    centre: Array
    R: Array


class Equations(NamedTuple):
    """One Gauss-Newton step: (3, 3), (3,), and the covariance (3, 3) of the gradient by the pixels' noise."""

    hessian: Array
    gradient: Array
    noise: Array


@njit
def project_with_slopes(p: Array, centre: Array, R: Array, lens: Array, slopes: Array) -> tuple[float, float]:
    """The pixel of a point; `slopes` (2, 3) gets its derivatives by the point. nan if it is not in front.

    Args:
        p: (3,) the point in the world, m.
        centre: (3,) the camera's place in the world, m.
        R: (3, 3) rotation from camera to world.
        lens: the lens as `CameraArrays` holds it.
        slopes: (2, 3) output, px per m.
    """
    x, y, z = p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]
    zc = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
    if not zc > 1e-9:
        return math.nan, math.nan
    a = (R[0, 0] * x + R[1, 0] * y + R[2, 0] * z) / zc
    b = (R[0, 1] * x + R[1, 1] * y + R[2, 1] * z) / zc
    # Farther out the distortion polynomial turns back, and one pixel would have two rays.
    if not math.hypot(a, b) < lens[FOLD]:
        return math.nan, math.nan
    ad, bd = distort_point(a, b, lens)
    xx, xy, yx, yy = slopes_at(a, b, lens)
    for i in range(3):
        # a = x / z: the quotient rule.
        da = (R[i, 0] - a * R[i, 2]) / zc
        db = (R[i, 1] - b * R[i, 2]) / zc
        slopes[0, i] = lens[FX] * (xx * da + xy * db)
        slopes[1, i] = lens[FY] * (yx * da + yy * db)
    return ad * lens[FX] + lens[CX], bd * lens[FY] + lens[CY]


@njit
def _weights(spread: Array, floor_px: float) -> tuple[float, float, float]:
    """The inverse (a, b, c) of [[a, b], [b, c]]: the covariance with the root `spread`, plus the floor's square."""
    a = spread[0, 0] ** 2 + spread[0, 1] ** 2 + floor_px**2
    b = spread[0, 0] * spread[1, 0] + spread[0, 1] * spread[1, 1]
    c = spread[1, 0] ** 2 + spread[1, 1] ** 2 + floor_px**2
    determinant = a * c - b * b
    return c / determinant, -b / determinant, a / determinant


@njit
def _normal_equations(
    p: Array, uvs: Array, rig: RigArrays, spreads: Array, floor_px: float, equations: Equations, distances: Array
) -> bool:
    """Fill the equations of one step and each camera's distance (C,) in pixels; false if a camera cannot see `p`.

    `noise` (3, 3) gets the covariance of the gradient by the pixels' noise, without the floor.
    """
    lenses, centres, Rs = rig
    hessian, gradient, noise = equations
    hessian[:], gradient[:], noise[:] = 0.0, 0.0, 0.0
    slopes, moved = np.empty((2, 3)), np.empty(3)
    for camera in range(len(lenses)):
        distances[camera] = math.nan
        if math.isnan(uvs[camera, 0]):
            continue
        u, v = project_with_slopes(p, centres[camera], Rs[camera], lenses[camera], slopes)
        if math.isnan(u):
            return False
        du, dv = uvs[camera, 0] - u, uvs[camera, 1] - v
        distances[camera] = math.hypot(du, dv)
        # The floor is in the weights only; `noise` has the pixels' own spread, so the covariance stays honest.
        a, b, c = _weights(spreads[camera], floor_px)
        for i in range(3):
            su, sv = slopes[0, i], slopes[1, i]
            gradient[i] += su * (a * du + b * dv) + sv * (b * du + c * dv)
            for j in range(3):
                hessian[i, j] += su * (a * slopes[0, j] + b * slopes[1, j]) + sv * (b * slopes[0, j] + c * slopes[1, j])
        for step in range(2):
            du, dv = spreads[camera, 0, step], spreads[camera, 1, step]
            for i in range(3):
                moved[i] = slopes[0, i] * (a * du + b * dv) + slopes[1, i] * (b * du + c * dv)
            for i in range(3):
                for j in range(3):
                    noise[i, j] += moved[i] * moved[j]
    return True


@njit
def refine_rows(
    uvs: Array,
    rig: RigArrays,
    spreads: Array,
    floor_px: float,
    ps: Array,
    residuals: Array,
    covs: Array,
    distances: Array,
) -> None:  # fmt: skip
    """Improve what `triangulate_rows` found where three cameras or more see the ball; rows of two stay as they are.

    `distances` (N, C) gets how far each camera's pixel is from the projected point, nan for cameras that do not see it.

    Args:
        uvs: (N, C, 2) pixels; nan where a camera has none.
        rig: the cameras.
        spreads: (N, C, 2, 2) a root of each pixel's covariance, px.
        floor_px: standard deviation that is added to that of every pixel: no camera decides alone.
        ps: (N, 3) points, improved in place, m.
        residuals: (N,) output, px.
        covs: (N, 3, 3) output, m^2.
        distances: (N, C) output, px.
    """
    cameras = len(rig.lenses)
    hessian, noise, inverse, scaled = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    gradient = np.empty(3)
    equations = Equations(hessian, gradient, noise)
    for row in range(len(uvs)):
        seen = 0
        for camera in range(cameras):
            seen += not math.isnan(uvs[row, camera, 0])
        p = ps[row].copy()
        usable, scale = not math.isnan(p[0]), 1.0
        for step in range(ROUNDS + 1):
            if not usable or not _normal_equations(p, uvs[row], rig, spreads[row], floor_px, equations, distances[row]):
                usable = False
                break
            # The limit of `invert_symmetric` is meant for entries near 1.
            scale = (hessian[0, 0] + hessian[1, 1] + hessian[2, 2]) / 3.0
            scaled[:] = hessian / scale
            if not invert_symmetric(scaled, inverse):
                usable = False
                break
            # The last round only evaluates: covariance and distances are those of the final point.
            if seen < 3 or step == ROUNDS:
                break
            p += (inverse @ gradient) / scale
        if not usable:
            if seen > 2:
                ps[row], residuals[row], covs[row] = math.nan, math.nan, math.nan
            distances[row] = math.nan
        elif seen > 2:
            ps[row], covs[row] = p, inverse @ noise @ inverse / scale**2
            residuals[row] = math.sqrt(np.nansum(distances[row] ** 2) / seen)
