"""Two or more cameras on one ball: rays to a point in the world, with its residual and covariance."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras.camera import Camera
from core.cameras.many_views_kernel import CameraArrays, RigArrays, refine_rows
from core.cameras.stereo_kernel import triangulate_rows
from core.config import check_settings, setting
from core.errors import CalibrationError

Array = NDArray[np.float64]
EASY: Final = 0.4
"""Cameras within such a share of what they may be off are not looked at more closely: nearly all points."""
CLEARLY: Final = 0.3
"""One group of cameras fits clearly better than another if it is off by less than such a share (choice)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TriangulationConfig:
    """What is believed of a pair of circles."""

    sigma_px: float = setting(1.0, 0.01, 20.0)
    """Standard deviation of a circle's centre along each picture axis. 1 px: the enclosing circle of a 2 ms window, at
    the end of it, on simulated serves."""
    max_residual_px: float = setting(6.0, 0.1, 100.0)
    """Rays that miss each other by more are not of one ball (choice: beyond nearly all pairs of simulated serves)."""
    outlier_px: float = setting(1.5, 0.1, 50.0)
    """With three cameras or more, one that is farther from the point of the others is left out (choice: a ball has a
    radius of 5 to 20 px, and a wrong pose of half a pixel is no reason)."""
    outlier_sigmas: float = setting(4.0, 1.0, 20.0)
    """But not one within so many of its own standard deviations (choice)."""
    floor_px: float = setting(0.1, 0.0, 10.0)
    """Added to the sigma of each of three cameras or more: no calibration is better, so no camera decides alone
    (choice)."""

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
    cameras: tuple[str, ...] = ()
    """Those that it is made of."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoints:
    """N points; nan where fewer than two rays exist, they are parallel, or meet behind a camera."""

    ps_world_m: Array
    """(N, 3)."""
    residuals_px: Array
    """(N,)."""
    covariances_m2: Array
    """(N, 3, 3)."""
    distances_px: Array | None = None
    """(N, C) of each camera's pixel from the projected point, nan where it sees none; None for rigs of two."""


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

    def camera_arrays(self, name: str) -> CameraArrays:
        """One camera for compiled code."""
        row = self.names.index(name)
        return CameraArrays(self._lenses[row], self._centres[row], self._Rs[row])

    def triangulate(self, uvs_px: ArrayLike, covariances_px2: ArrayLike | None = None) -> TriangulatedPoints:
        """The points of simultaneous pixels (N, C, 2), C in the order of `names`; nan: not seen by that camera.

        `covariances_px2` (N, C, 2, 2) of the pixels; by default, and where they are nan, as `config.sigma_px` says.
        Three cameras or more are weighted by these. Nothing is gated: `config.max_residual_px` is for the caller, or
        use `triangulate_one`.
        """
        uvs = np.ascontiguousarray(uvs_px, np.float64)
        if uvs.ndim != 3 or uvs.shape[1:] != (len(self.names), 2):
            expected = f"(N, {len(self.names)}, 2)"
            raise CalibrationError("not one pixel per camera", expected=expected, got=uvs.shape, where="triangulate")
        return self._solve(uvs, self._roots(len(uvs), covariances_px2))

    def _roots(self, n: int, covariances_px2: ArrayLike | None) -> Array:
        """Roots (N, C, 2, 2) of the covariances of the pixels."""
        spreads = np.broadcast_to(self.config.sigma_px * np.eye(2), (n, len(self.names), 2, 2))
        if covariances_px2 is not None:
            spreads = _spreads(np.asarray(covariances_px2, np.float64), spreads)
        return np.ascontiguousarray(spreads)

    def _solve(self, uvs: Array, spreads: Array) -> TriangulatedPoints:
        n, cameras = uvs.shape[:2]
        distances = np.full((n, cameras), np.nan) if cameras > 2 else None
        points = TriangulatedPoints(np.empty((n, 3)), np.empty(n), np.empty((n, 3, 3)), distances)
        triangulate_rows(
            uvs,
            self._lenses,
            self._centres,
            self._Rs,
            spreads,
            points.ps_world_m,
            points.residuals_px,
            points.covariances_m2,
        )
        if distances is not None:
            refine_rows(
                uvs,
                RigArrays(self._lenses, self._centres, self._Rs),
                spreads,
                self.config.floor_px,
                points.ps_world_m,
                points.residuals_px,
                points.covariances_m2,
                distances,
            )
        return points

    def triangulate_one(self, uvs_px: ArrayLike, covariances_px2: ArrayLike | None = None) -> TriangulatedPoint | None:
        """The point of pixels (C, 2) with covariances (C, 2, 2).

        None if there is none or its residual is above `config.max_residual_px`. Of three cameras or more that see
        something, those are left out that see something else than most others.
        """
        uvs = np.ascontiguousarray(uvs_px, np.float64)[None]
        covariances = None if covariances_px2 is None else np.asarray(covariances_px2, np.float64)[None]
        roots = self._roots(1, covariances)
        points = self._solve(uvs, roots)
        seen = np.isfinite(uvs[0, :, 0])
        row = 0
        if points.distances_px is not None and seen.sum() > 2:
            limits_px = np.maximum(
                self.config.outlier_px, self.config.outlier_sigmas * np.linalg.norm(roots[0], axis=(1, 2)) / np.sqrt(2)
            )
            if not _strain(points.distances_px, limits_px)[0] <= EASY:
                points, seen, row = self._leave_out(uvs[0], roots[0], seen, limits_px)
        residual = float(points.residuals_px[row])
        if not residual <= self.config.max_residual_px:
            return None
        cameras = tuple(name for name, used in zip(self.names, seen, strict=True) if used)
        return TriangulatedPoint(points.ps_world_m[row], residual, points.covariances_m2[row], cameras)

    def _leave_out(
        self, uvs: Array, roots: Array, seen: NDArray[np.bool_], limits_px: Array
    ) -> tuple[TriangulatedPoints, NDArray[np.bool_], int]:
        """Points of groups of the cameras that see something, a group of each row, and the row to take.

        It is the largest group whose cameras all fit, of equally large ones that which fits best. All are taken if no
        group fits, or if several pairs do: two rays may meet by chance.
        """
        names = np.flatnonzero(seen).tolist()
        groups = [group for size in range(len(names), 1, -1) for group in itertools.combinations(names, size)]
        members = np.zeros((len(groups), len(seen)), np.bool_)
        for row, group in enumerate(groups):
            members[row, list(group)] = True
        points = self._solve(
            np.where(members[:, :, None], uvs, np.nan),
            np.ascontiguousarray(np.broadcast_to(roots, (len(groups), *roots.shape))),
        )
        assert points.distances_px is not None
        strains = _strain(points.distances_px, limits_px)
        fitting = np.flatnonzero(strains <= 1.0)
        if not len(fitting):
            return points, members[0], 0
        sizes = members.sum(axis=1)
        best, *others = sorted(fitting.tolist(), key=lambda row: (-sizes[row], strains[row]))
        if best == 0 and others and sizes[others[0]] == sizes[0] - 1 > 2 and strains[others[0]] < CLEARLY * strains[0]:
            best = others[0]  # all fit, but only because a wrong one draws the others to it
        elif sizes[best] == 2 and others and strains[best] > CLEARLY * strains[others[0]]:
            best = 0
        return points, members[best], best


def _strain(distances_px: Array, limits_px: Array) -> Array:
    """(N,) the greatest distance of a camera over what it may be; infinite where there is no point."""
    shares = distances_px / limits_px
    strains = np.max(np.where(np.isnan(shares), -np.inf, shares), axis=1)
    return np.where(np.isnan(shares).all(axis=1), np.inf, strains)


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
