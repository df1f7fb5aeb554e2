"""Where the rays of several cameras meet, and how well a point is known by them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

INNER_ROUNDS: Final = 1
"""Newton steps of a point from where its rays come nearest to each other: what is left after one does not count."""
SINGULAR: Final = 1e-12
"""Determinant over the cubed trace below which rays are parallel, and a point's place along them is not fixed."""
NEAREST: Final = 1e-6
"""Depth in front of a camera."""


def points_of(Ts_frame_camera: Array, xys: Array, focals_px: Array) -> Array:
    """The points (N, 3) with the smallest reprojection errors; nan with fewer than two sightings.

    Args:
        Ts_frame_camera: (C, 4, 4) poses of the cameras; the points are in their common frame.
        xys: (N, C, 2) pinhole coordinates, nan where a camera saw nothing.
        focals_px: (C,) turns pinhole coordinates into pixels, in which errors are compared.
    """
    normal, right = np.zeros((len(xys), 3, 3)), np.zeros((len(xys), 3))
    seen = np.isfinite(xys[..., 0])
    for c, T in enumerate(Ts_frame_camera):
        rays = np.column_stack([xys[:, c], np.ones(len(xys))]) @ T[:3, :3].T
        rays[~seen[:, c]] = np.nan
        rays /= np.sqrt((rays * rays).sum(axis=1, keepdims=True))
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        across[~seen[:, c]] = 0.0
        normal += across
        right += across @ T[:3, 3]
    inverse = inverses(normal)
    right[(seen.sum(axis=1) < 2) | ~inverse.any(axis=(1, 2))] = np.nan
    ps: Array = (inverse @ right[..., None])[..., 0]
    for _ in range(INNER_ROUNDS):
        slopes = np.nan_to_num(_slopes(Ts_frame_camera, ps, xys, focals_px)).reshape(len(ps), -1, 3)
        errors = np.nan_to_num(_errors(Ts_frame_camera, ps, xys, focals_px)).reshape(len(ps), -1, 1)
        turned = slopes.transpose(0, 2, 1)
        ps += (inverses(turned @ slopes) @ (turned @ errors))[..., 0]  # stays where not in front of two cameras
    return ps


def point_information(Ts_frame_camera: Array, ps: Array, xys: Array, focals_px: Array, sigma_px: float) -> Array:
    """(N, 3, 3) inverse covariances of points seen in pixels that err by `sigma_px`; nan where a point is none.

    Args:
        Ts_frame_camera: (C, 4, 4) poses of the cameras.
        ps: (N, 3) points in the frame.
        xys: (N, C, 2) pinhole coordinates; nan where a camera does not see the point.
        focals_px: (C,) focal lengths.
        sigma_px: standard deviation of a pixel along each axis.
    """
    slopes = np.nan_to_num(_slopes(Ts_frame_camera, ps, xys, focals_px)).reshape(len(ps), -1, 3) / sigma_px
    information = slopes.transpose(0, 2, 1) @ slopes
    information[~np.isfinite(ps).all(axis=1)] = np.nan
    return information


def _errors(Ts_frame_camera: Array, ps: Array, xys: Array, focals_px: Array) -> Array:
    """(N, C, 2) seen minus projected, in pixels; nan where not seen or not in front."""
    errors = np.empty_like(xys)
    for c, T in enumerate(Ts_frame_camera):
        local = (ps - T[:3, 3]) @ T[:3, :3]
        z = np.where(local[:, 2] > NEAREST, local[:, 2], np.nan)
        errors[:, c] = (xys[:, c] - local[:, :2] / z[:, None]) * focals_px[c]
    return errors


def _slopes(Ts_frame_camera: Array, ps: Array, xys: Array, focals_px: Array) -> Array:
    """(N, C, 2, 3) of the projection in pixels by the point; nan where not seen or not in front."""
    slopes = np.empty((*xys.shape, 3))
    for c, T in enumerate(Ts_frame_camera):
        local = (ps - T[:3, 3]) @ T[:3, :3]
        z = np.where((local[:, 2] > NEAREST) & np.isfinite(xys[:, c, 0]), local[:, 2], np.nan)[:, None]
        for axis in (0, 1):
            slopes[:, c, axis] = focals_px[c] / z * (T[:3, axis] - local[:, axis : axis + 1] / z * T[:3, 2])
    return slopes


def inverses(a: Array) -> Array:
    """Inverses of symmetric (N, 3, 3), 0 where singular; numpy's own take several times as long over so small ones."""
    xx, xy, xz, yy, yz, zz = a[:, 0, 0], a[:, 0, 1], a[:, 0, 2], a[:, 1, 1], a[:, 1, 2], a[:, 2, 2]
    cofactors = np.empty_like(a)
    cofactors[:, 0, 0], cofactors[:, 1, 1], cofactors[:, 2, 2] = yy * zz - yz**2, xx * zz - xz**2, xx * yy - xy**2
    cofactors[:, 0, 1] = cofactors[:, 1, 0] = xz * yz - xy * zz
    cofactors[:, 0, 2] = cofactors[:, 2, 0] = xy * yz - xz * yy
    cofactors[:, 1, 2] = cofactors[:, 2, 1] = xy * xz - xx * yz
    determinants = (a[:, 0] * cofactors[:, 0]).sum(axis=1)
    regular = determinants > SINGULAR * (xx + yy + zz) ** 3
    return np.where(regular[:, None, None], cofactors / np.where(regular, determinants, 1.0)[:, None, None], 0.0)
