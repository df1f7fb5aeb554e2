"""Lens distortion and its inverse, on pinhole coordinates x / z and y / z, by OpenCV's models.

The inverse is our own: OpenCV's stops after five fixed-point rounds unless told otherwise, how it is told differs
between its versions 4 and 5, and five rounds are 1e-2 px off in the corners of a k1 = -0.3 lens. Its fisheye inverse
stops after ten rounds and knows no rays beyond the fold.
"""

from __future__ import annotations

import functools
import math
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.cameras import lens_kernel as kernel
from core.cameras.lens_kernel import CONVERGED, NEWTON_ROUNDS, WRONG

Array = NDArray[np.float64]
LensModel = Literal["pinhole", "fisheye"]
"""How rays become pixels: OpenCV's pinhole with its polynomial, or its fisheye (Kannala-Brandt, "equidistant")."""

COEFFICIENTS: Final[dict[LensModel, tuple[int, ...]]] = {"pinhole": (5, 8, 12, 14), "fisheye": (4,)}
"""How many coefficients a camera of each model has."""
ORDER: Final[dict[LensModel, str]] = {
    "pinhole": "k1 k2 p1 p2 k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]",
    "fisheye": "k1 k2 k3 k4",
}
"""Their order, which is OpenCV's."""


def distort(xys: Array, distortion: Array, model: LensModel = "pinhole") -> Array:
    """Where the lens puts pinhole coordinates (N, 2); the coefficients as in `ORDER`."""
    if model != "pinhole" or len(distortion) != 5:
        moved = np.empty((len(xys), 2))
        kernel.distort_rows(np.ascontiguousarray(xys, np.float64), unit_lens(distortion, model), moved)
        return moved
    k1, k2, p1, p2, k3 = distortion
    x, y = xys.T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
    )


def undistort(xys_distorted: Array, distortion: Array, model: LensModel = "pinhole") -> Array:
    """The pinhole coordinates (N, 2) that `distort` maps to the given ones; nan where there are none (Newton)."""
    if model == "fisheye" or (len(distortion) != 5 and distortion.any()):
        straight = np.empty((len(xys_distorted), 2))
        points = np.ascontiguousarray(xys_distorted, np.float64)
        kernel.undistort_rows(points, unit_lens(distortion, model), straight)
        return straight
    if not distortion.any() or not len(xys_distorted):
        return np.array(xys_distorted, np.float64)
    k1, k2, p1, p2, k3 = distortion
    x, y = np.array(xys_distorted, np.float64).T
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_ROUNDS):
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
            dx_dx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
            dy_dy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
            dx_dy = slope * x * y + 2 * p1 * x + 2 * p2 * y
            error_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - xys_distorted[:, 0]
            error_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - xys_distorted[:, 1]
            determinant = dx_dx * dy_dy - dx_dy * dx_dy
            step_x = (dy_dy * error_x - dx_dy * error_y) / determinant
            step_y = (dx_dx * error_y - dx_dy * error_x) / determinant
            x, y = x - step_x, y - step_y
            if not ((np.abs(step_x) > CONVERGED) | (np.abs(step_y) > CONVERGED)).any():  # nan never converges
                break
        xys = np.column_stack([x, y])
        right = np.abs(distort(xys, distortion) - xys_distorted).max(axis=1) < WRONG
        right &= np.hypot(x, y) < fold_radius(distortion)
    xys[~right] = np.nan
    return xys


def distortion_slopes(xys: Array, distortion: Array, model: LensModel = "pinhole") -> Array:
    """(N, 2, 2) derivatives of `distort` at pinhole coordinates (N, 2)."""
    slopes = np.empty((len(xys), 2, 2))
    kernel.slopes_rows(np.ascontiguousarray(xys, np.float64), unit_lens(distortion, model), slopes)
    return slopes


def fold_radius(distortion: Array, model: LensModel = "pinhole") -> float:
    """The radius beyond which the lens turns back and points would fold into the picture, or infinity."""
    coefficients = tuple(map(float, distortion))
    if model == "fisheye":
        angle = _fold_angle(coefficients)
        return math.tan(angle) if angle < math.pi / 2 else math.inf
    if len(coefficients) == 5 or not any(coefficients[5:8]):
        return _fold_radius(coefficients[0], coefficients[1], coefficients[4])
    return _rational_fold(coefficients)


def lens_row(K: Array, distortion: Array, model: LensModel) -> Array:
    """A lens as `core.cameras.lens_kernel` wants it: (LENS_SIZE,)."""
    row = unit_lens(distortion, model).copy()
    row[[kernel.FX, kernel.FY, kernel.CX, kernel.CY]] = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    return row


def unit_lens(distortion: Array, model: LensModel) -> Array:
    """The row of a lens of focal length 1 with its centre at 0; read-only."""
    return _unit_lens(tuple(map(float, distortion)), model)


@functools.lru_cache(maxsize=64)
def _unit_lens(coefficients: tuple[float, ...], model: LensModel) -> Array:
    row = np.zeros(kernel.LENS_SIZE)
    row[[kernel.FX, kernel.FY]] = 1.0
    kinds = {5: kernel.RADIAL, 8: kernel.RATIONAL, 12: kernel.RATIONAL, 14: kernel.TILTED}
    row[kernel.KIND] = kernel.FISHEYE if model == "fisheye" else kinds[len(coefficients)]
    row[kernel.FOLD] = fold_radius(np.array(coefficients), model)
    row[kernel.FOLD_ANGLE] = _fold_angle(coefficients) if model == "fisheye" else math.inf
    row[kernel.K1 : kernel.K1 + min(len(coefficients), 12)] = coefficients[:12]
    tilt = tilt_matrix(*coefficients[12:14])
    row[kernel.TILT : kernel.TILT + 9] = tilt.ravel()
    row[kernel.UNTILT : kernel.UNTILT + 9] = np.linalg.inv(tilt).ravel()
    row.flags.writeable = False
    return row


def tilt_matrix(about_x_rad: float = 0.0, about_y_rad: float = 0.0) -> Array:
    """(3, 3) what a tilted sensor does to coordinates on a straight one, as OpenCV's `computeTiltProjectionMatrix`."""
    cx, sx, cy, sy = math.cos(about_x_rad), math.sin(about_x_rad), math.cos(about_y_rad), math.sin(about_y_rad)
    R = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    back = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]])
    return back @ R


@functools.lru_cache(maxsize=64)
def _fold_radius(k1: float, k2: float, k3: float) -> float:
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0]) if k1 or k2 or k3 else np.array([])
    squares = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
    return min(squares) ** 0.5 if squares else np.inf


@functools.lru_cache(maxsize=64)
def _rational_fold(coefficients: tuple[float, ...]) -> float:
    """Where the derivative of r N(r^2) / D(r^2) is 0, or D is."""
    above = np.poly1d([coefficients[4], coefficients[1], coefficients[0], 1.0])
    below = np.poly1d([*coefficients[7:4:-1], 1.0])
    turn = above * below + np.poly1d([2.0, 0.0]) * (above.deriv() * below - above * below.deriv())
    roots = np.concatenate([turn.roots, below.roots])
    squares = [root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0]
    return min(squares) ** 0.5 if squares else math.inf


@functools.lru_cache(maxsize=64)
def _fold_angle(coefficients: tuple[float, ...]) -> float:
    """The angle from the axis at which a fisheye lens turns back, or infinity."""
    k1, k2, k3, k4 = coefficients
    roots = np.roots([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0]) if any(coefficients) else np.array([])
    squares = [root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0]
    return min(squares) ** 0.5 if squares else math.inf
