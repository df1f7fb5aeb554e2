"""Two or more cameras on one ball: rays to a point in the world, with its residual and covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras.camera import Camera
from core.cameras.stereo_kernel import triangulate_rows
from core.config import check_settings, setting
from core.errors import CalibrationError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TriangulationConfig:
    """What is believed of a pair of circles."""

    sigma_px: float = setting(1.0, 0.01, 20.0)
    """Standard deviation of a circle's centre along each picture axis. 1 px: the enclosing circle of a 2 ms window, at
    the end of it, on simulated serves."""
    max_residual_px: float = setting(6.0, 0.1, 100.0)
    """Rays that miss each other by more are not of one ball (choice: beyond nearly all pairs of simulated serves)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoint:
    """Where the rays of one instant meet."""

    p_world_m: Array
    """(3,)."""
    residual_px: float
    """Root mean square over the cameras of the distance between pixel and projected point. An error along the epipolar
    line moves the point and leaves no residual: two views cannot see it."""
    covariance_m2: Array
    """(3, 3), from the pixel noise."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoints:
    """N points; nan where fewer than two rays exist, they are parallel, or meet behind a camera."""

    ps_world_m: Array
    """(N, 3)."""
    residuals_px: Array
    """(N,)."""
    covariances_m2: Array
    """(N, 3, 3)."""


class StereoRig:
    """Calibrated cameras in a fixed order, prepared for triangulation."""

    def __init__(self, cameras: Mapping[str, Camera], config: TriangulationConfig | None = None) -> None:
        """Raises CalibrationError with fewer than two cameras, or two in one place."""
        if len(cameras) < 2:
            got = ", ".join(cameras) or "none"
            raise CalibrationError("a position in space needs two views", expected="two cameras or more", got=got)
        self.names = tuple(cameras)
        self.config = config or TriangulationConfig()
        views = list(cameras.values())
        self._centres = np.array([view.position_world_m for view in views])
        if np.ptp(self._centres, axis=0).max() < 1e-6:
            raise CalibrationError("the cameras stand in one place: no depth", got=self._centres[0].round(4).tolist())
        self._Rs = np.array([view.T_world_camera[:3, :3] for view in views])
        self._lenses = np.array([view.lens_row() for view in views])

    def triangulate(self, uvs_px: ArrayLike, covariances_px2: ArrayLike | None = None) -> TriangulatedPoints:
        """The points of simultaneous pixels (N, C, 2), C in the order of `names`; nan: not seen by that camera.

        `covariances_px2` (N, C, 2, 2) of the pixels; by default, and where they are nan, as `config.sigma_px` says.
        Nothing is gated: `config.max_residual_px` is for the caller, or use `triangulate_one`.
        """
        uvs = np.ascontiguousarray(uvs_px, np.float64)
        if uvs.ndim != 3 or uvs.shape[1:] != (len(self.names), 2):
            expected = f"(N, {len(self.names)}, 2)"
            raise CalibrationError("not one pixel per camera", expected=expected, got=uvs.shape, where="triangulate")
        n = len(uvs)
        spreads = np.broadcast_to(self.config.sigma_px * np.eye(2), (n, len(self.names), 2, 2))
        if covariances_px2 is not None:
            spreads = _spreads(np.asarray(covariances_px2, np.float64), spreads)
        points = TriangulatedPoints(np.empty((n, 3)), np.empty(n), np.empty((n, 3, 3)))
        triangulate_rows(
            uvs,
            self._lenses,
            self._centres,
            self._Rs,
            np.ascontiguousarray(spreads),
            points.ps_world_m,
            points.residuals_px,
            points.covariances_m2,
        )
        return points

    def triangulate_one(self, uvs_px: ArrayLike, covariances_px2: ArrayLike | None = None) -> TriangulatedPoint | None:
        """The point of pixels (C, 2) with covariances (C, 2, 2).

        None if there is none or its residual is above `config.max_residual_px`.
        """
        covariances = None if covariances_px2 is None else np.asarray(covariances_px2, np.float64)[None]
        points = self.triangulate(np.asarray(uvs_px, np.float64)[None], covariances)
        residual = float(points.residuals_px[0])
        if not residual <= self.config.max_residual_px:
            return None
        return TriangulatedPoint(points.ps_world_m[0], residual, points.covariances_m2[0])


def interpolate_pixels(t_us: ArrayLike, uvs_px: ArrayLike, at_us: ArrayLike, *, max_gap_us: int) -> Array:
    """The positions (M, 2) at `at_us` (M,) of one camera's track (N,) (N, 2), linear in time; nan outside it.

    Nan too where the track has a gap of more than `max_gap_us` around the time. Cameras whose answers carry different
    times are brought to one time with this before they are triangulated: at 9 m/s, 1 ms is 9 mm.
    """
    t, at = np.asarray(t_us, np.int64), np.atleast_1d(np.asarray(at_us, np.int64))
    uvs = np.asarray(uvs_px, np.float64).reshape(-1, 2)
    if not len(t):
        return np.full((len(at), 2), np.nan)
    after = np.clip(np.searchsorted(t, at, side="left"), 0, len(t) - 1)
    before = np.where(t[after] == at, after, np.maximum(after - 1, 0))
    span = t[after] - t[before]
    inside = (t[0] <= at) & (at <= t[-1]) & (span <= max_gap_us)
    share = (at - t[before]) / np.maximum(span, 1)
    found = uvs[before] + share[:, None] * (uvs[after] - uvs[before])
    found[~inside] = np.nan
    return found


def _spreads(covariances_px2: Array, default: Array) -> Array:
    """Lower roots (N, C, 2, 2) of covariances; the default where they are nan."""
    known = np.isfinite(covariances_px2).all(axis=(2, 3))
    spreads = default.copy()
    a, b, c = covariances_px2[known][:, 0, 0], covariances_px2[known][:, 1, 0], covariances_px2[known][:, 1, 1]
    first = np.sqrt(a)
    roots = np.zeros((len(a), 2, 2))
    roots[:, 0, 0], roots[:, 1, 0], roots[:, 1, 1] = first, b / first, np.sqrt(np.maximum(c - b * b / a, 0.0))
    spreads[known] = roots
    return spreads
