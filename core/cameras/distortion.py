"""OpenCV's five-coefficient lens distortion and its inverse, on pinhole coordinates x / z and y / z.

The inverse is our own: OpenCV's stops after five fixed-point rounds unless told otherwise, how it is told differs
between its versions 4 and 5, and five rounds are 1e-2 px off in the corners of a k1 = -0.3 lens.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NEWTON_ROUNDS = 20
CONVERGED = 1e-12
WRONG = 1e-7
"""A tenth of a thousandth of a pixel at f = 1000 px."""


def distort(xys: Array, distortion: Array) -> Array:
    """Where the lens puts pinhole coordinates (N, 2); distortion k1 k2 p1 p2 k3."""
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


def undistort(xys_distorted: Array, distortion: Array) -> Array:
    """The pinhole coordinates (N, 2) that `distort` maps to the given ones; nan where there are none (Newton)."""
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


def fold_radius(distortion: Array) -> float:
    """The radius beyond which the radial polynomial turns back and points would fold into the picture, or infinity."""
    return _fold_radius(float(distortion[0]), float(distortion[1]), float(distortion[4]))


@functools.lru_cache(maxsize=64)
def _fold_radius(k1: float, k2: float, k3: float) -> float:
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0]) if k1 or k2 or k3 else np.array([])
    squares = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
    return min(squares) ** 0.5 if squares else np.inf
