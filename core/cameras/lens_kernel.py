"""Compiled lens arithmetic for one point: where a lens puts it, the slopes there, and the way back.

A lens is a row of `LENS_SIZE` numbers that `lens_row` makes. The models are those of OpenCV: the pinhole with 5, 8, 12
or 14 coefficients (`projectPoints`: radial, rational, thin prism, tilted sensor), and the fisheye lens of Kannala and
Brandt with 4 (`fisheye.projectPoints`; `equidistant` in ROS and Kalibr). Points are pinhole coordinates x / z, y / z.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.jit import njit

Array = NDArray[np.float64]

NEWTON_ROUNDS: Final = 20
"""At most: Newton's method doubles the digits in each round, so what needs more than a few has no solution."""
FISHEYE_ROUNDS: Final = 50
"""At most, of the search for an angle, which halves an interval where Newton's step leaves it."""
CONVERGED: Final = 1e-12
"""Step of a pinhole coordinate that ends the search (chosen: well above the rounding of numbers near 1)."""
WRONG: Final = 1e-7
"""Largest error of a pinhole coordinate, 1e-4 px at f = 1000 px: no ray leads to a pixel that is missed by more."""
BRACKET_RAD: Final = math.pi / 2 - 1e-6
"""Rays farther from the axis have no pinhole coordinates."""

FX, FY, CX, CY, KIND, FOLD, FOLD_ANGLE = range(7)
K1, K2, P1, P2, K3, K4, K5, K6, S1, S2, S3, S4 = range(7, 19)
TILT: Final = 19
"""Nine numbers: the matrix of a tilted sensor, row by row."""
UNTILT: Final = 28
"""Nine numbers: its inverse."""
LENS_SIZE: Final = 37
RADIAL, RATIONAL, TILTED, FISHEYE = 0.0, 1.0, 2.0, 3.0
"""Values of KIND: 5 coefficients; 8 or 12; 14; fisheye, whose four coefficients stand at K1, K2, P1 and P2."""


@njit(error_model="numpy")
def _fisheye_angle(angle: float, lens: Array) -> float:
    """Where the lens puts a ray at this angle from the axis, in focal lengths from the centre."""
    a2 = angle * angle
    return angle * (1 + a2 * (lens[K1] + a2 * (lens[K2] + a2 * (lens[P1] + a2 * lens[P2]))))


@njit(error_model="numpy")
def _fisheye_slope(angle: float, lens: Array) -> float:
    a2 = angle * angle
    return 1 + a2 * (3 * lens[K1] + a2 * (5 * lens[K2] + a2 * (7 * lens[P1] + a2 * 9 * lens[P2])))


@njit(error_model="numpy")
def _project_tilt(x: float, y: float, lens: Array, at: int) -> tuple[float, float]:
    depth = lens[at + 6] * x + lens[at + 7] * y + lens[at + 8]
    return (
        (lens[at] * x + lens[at + 1] * y + lens[at + 2]) / depth,
        (lens[at + 3] * x + lens[at + 4] * y + lens[at + 5]) / depth,
    )


@njit(error_model="numpy")
def _distort_flat(x: float, y: float, lens: Array) -> tuple[float, float]:
    """Like `distort_point`, without the tilt of the sensor."""
    r2 = x * x + y * y
    if lens[KIND] == FISHEYE:
        r = math.sqrt(r2)
        stretch = 1.0 if r < 1e-12 else _fisheye_angle(math.atan(r), lens) / r
        return x * stretch, y * stretch
    radial = 1 + r2 * (lens[K1] + r2 * (lens[K2] + r2 * lens[K3]))
    if lens[KIND] == RADIAL:
        return (
            x * radial + 2 * lens[P1] * x * y + lens[P2] * (r2 + 2 * x * x),
            y * radial + lens[P1] * (r2 + 2 * y * y) + 2 * lens[P2] * x * y,
        )
    radial /= 1 + r2 * (lens[K4] + r2 * (lens[K5] + r2 * lens[K6]))
    return (
        x * radial + 2 * lens[P1] * x * y + lens[P2] * (r2 + 2 * x * x) + r2 * (lens[S1] + r2 * lens[S2]),
        y * radial + lens[P1] * (r2 + 2 * y * y) + 2 * lens[P2] * x * y + r2 * (lens[S3] + r2 * lens[S4]),
    )


@njit(error_model="numpy")
def distort_point(x: float, y: float, lens: Array) -> tuple[float, float]:
    """Where the lens puts pinhole coordinates, in focal lengths from the centre."""
    x, y = _distort_flat(x, y, lens)
    return _project_tilt(x, y, lens, TILT) if lens[KIND] == TILTED else (x, y)


@njit(error_model="numpy")
def _slopes_flat(x: float, y: float, lens: Array) -> tuple[float, float, float, float]:
    r2 = x * x + y * y
    if lens[KIND] == FISHEYE:
        r = math.sqrt(r2)
        # On the axis both slopes are 0 / 0; their limit is 1.
        if r < 1e-6:
            return 1.0, 0.0, 0.0, 1.0
        angle = math.atan(r)
        across = _fisheye_angle(angle, lens) / r
        along = _fisheye_slope(angle, lens) / (1 + r2)
        # A radial map stretches by its own slope along the radius, and by angle over radius across it.
        turn = (along - across) / r2
        return across + turn * x * x, turn * x * y, turn * x * y, across + turn * y * y
    radial = 1 + r2 * (lens[K1] + r2 * (lens[K2] + r2 * lens[K3]))
    slope = 2 * (lens[K1] + r2 * (2 * lens[K2] + r2 * 3 * lens[K3]))
    if lens[KIND] == RADIAL:
        xy = slope * x * y + 2 * lens[P1] * x + 2 * lens[P2] * y
        return (
            radial + slope * x * x + 2 * lens[P1] * y + 6 * lens[P2] * x,
            xy,
            xy,
            radial + slope * y * y + 6 * lens[P1] * y + 2 * lens[P2] * x,
        )
    below = 1 + r2 * (lens[K4] + r2 * (lens[K5] + r2 * lens[K6]))
    below_slope = 2 * (lens[K4] + r2 * (2 * lens[K5] + r2 * 3 * lens[K6]))
    # Quotient rule: the rational model divides two such polynomials (OpenCV).
    slope = (slope - radial / below * below_slope) / below
    radial /= below
    prism_x, prism_y = 2 * (lens[S1] + 2 * lens[S2] * r2), 2 * (lens[S3] + 2 * lens[S4] * r2)
    return (
        radial + slope * x * x + 2 * lens[P1] * y + 6 * lens[P2] * x + prism_x * x,
        slope * x * y + 2 * lens[P1] * x + 2 * lens[P2] * y + prism_x * y,
        slope * x * y + 2 * lens[P1] * x + 2 * lens[P2] * y + prism_y * x,
        radial + slope * y * y + 6 * lens[P1] * y + 2 * lens[P2] * x + prism_y * y,
    )


@njit(error_model="numpy")
def slopes_at(x: float, y: float, lens: Array) -> tuple[float, float, float, float]:
    """Derivatives of `distort_point`: of its x by x and by y, of its y by x and by y."""
    xx, xy, yx, yy = _slopes_flat(x, y, lens)
    if lens[KIND] != TILTED:
        return xx, xy, yx, yy
    u, v = _distort_flat(x, y, lens)
    depth = lens[TILT + 6] * u + lens[TILT + 7] * v + lens[TILT + 8]
    u, v = _project_tilt(u, v, lens, TILT)
    uu, uv = (lens[TILT] - u * lens[TILT + 6]) / depth, (lens[TILT + 1] - u * lens[TILT + 7]) / depth
    vu, vv = (lens[TILT + 3] - v * lens[TILT + 6]) / depth, (lens[TILT + 4] - v * lens[TILT + 7]) / depth
    return uu * xx + uv * yx, uu * xy + uv * yy, vu * xx + vv * yx, vu * xy + vv * yy


@njit(error_model="numpy")
def _undistort_fisheye(x_lens: float, y_lens: float, lens: Array) -> tuple[float, float]:
    """Newton's method for the angle, held between bounds; nan beyond 90 degrees and beyond the fold."""
    target = math.hypot(x_lens, y_lens)
    if target < 1e-12:
        return x_lens, y_lens
    low, high = 0.0, min(lens[FOLD_ANGLE], BRACKET_RAD)
    if not target < _fisheye_angle(high, lens):
        return math.nan, math.nan
    angle = min(target, high)
    for _ in range(FISHEYE_ROUNDS):
        error = _fisheye_angle(angle, lens) - target
        if error > 0:
            high = angle
        else:
            low = angle
        slope = _fisheye_slope(angle, lens)
        before = angle
        angle = angle - error / slope if slope > 0 else low
        if not low < angle < high:
            angle = (low + high) / 2
        if abs(angle - before) < 1e-15:
            break
    stretch = math.tan(angle) / target
    return x_lens * stretch, y_lens * stretch


@njit(error_model="numpy")
def undistort_point(u: float, v: float, lens: Array) -> tuple[float, float]:
    """Pinhole coordinates of a pixel by Newton's method; nan where no ray leads there."""
    x_lens, y_lens = (u - lens[CX]) / lens[FX], (v - lens[CY]) / lens[FY]
    if lens[KIND] == FISHEYE:
        return _undistort_fisheye(x_lens, y_lens, lens)
    if lens[KIND] == TILTED:
        x_lens, y_lens = _project_tilt(x_lens, y_lens, lens, UNTILT)
    x, y = x_lens, y_lens
    for _ in range(NEWTON_ROUNDS):
        x_here, y_here = _distort_flat(x, y, lens)
        xx, xy, yx, yy = _slopes_flat(x, y, lens)
        determinant = xx * yy - xy * yx
        if determinant == 0:
            return math.nan, math.nan
        step_x = (yy * (x_here - x_lens) - xy * (y_here - y_lens)) / determinant
        step_y = (xx * (y_here - y_lens) - yx * (x_here - x_lens)) / determinant
        x, y = x - step_x, y - step_y
        if not (abs(step_x) > CONVERGED or abs(step_y) > CONVERGED):
            break
    x_here, y_here = _distort_flat(x, y, lens)
    if not (abs(x_here - x_lens) < WRONG and abs(y_here - y_lens) < WRONG and math.hypot(x, y) < lens[FOLD]):
        return math.nan, math.nan
    return x, y


@njit(error_model="numpy")
def distort_rows(xys: Array, lens: Array, out: Array) -> None:
    """`distort_point` of every row of (N, 2)."""
    for row in range(len(xys)):
        out[row, 0], out[row, 1] = distort_point(xys[row, 0], xys[row, 1], lens)


@njit(error_model="numpy")
def undistort_rows(uvs: Array, lens: Array, out: Array) -> None:
    """`undistort_point` of every row of (N, 2)."""
    for row in range(len(uvs)):
        out[row, 0], out[row, 1] = undistort_point(uvs[row, 0], uvs[row, 1], lens)


@njit(error_model="numpy")
def slopes_rows(xys: Array, lens: Array, out: Array) -> None:
    """`slopes_at` of every row of (N, 2), as (N, 2, 2)."""
    for row in range(len(xys)):
        xx, xy, yx, yy = slopes_at(xys[row, 0], xys[row, 1], lens)
        out[row, 0, 0], out[row, 0, 1], out[row, 1, 0], out[row, 1, 1] = xx, xy, yx, yy
