"""Two or more cameras on one ball: rays to a point in the world, with its residual and covariance.

And how far two cameras' sightings are from their epipolar lines, and how much of that is a wrong relative pose.
"""

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
        # The nearest point to rays weighs them in metres; with more than two, the errors in pixels decide.
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

    Args:
        t_us: (N,) times of the track, ascending.
        uvs_px: (N, 2) its positions.
        at_us: (M,) the times that are asked for.
        max_gap_us: longest time between two positions that are joined by a line.
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


UNKNOWNS: Final = 5
"""Numbers of a relative pose that pictures determine: three of the rotation, two of the direction of the baseline."""
ROUNDS: Final = 12
HUBER_SIGMAS: Final = 1.5
"""Sightings farther off than that pull no harder (Huber's weights)."""
MIN_SIGMA_PX: Final = 0.02
"""Least sigma of the residuals: without it sightings that fit exactly would give all others no weight."""
LIKELY_TURN: Final = 3e-3
"""Radians that a camera is turned by, when it is: for what is said of places where nothing was seen."""


@dataclass(frozen=True, slots=True)
class EpipolarDrift:
    """What sightings say of a calibration."""

    drift_px: float
    """Root mean square over the sightings of the distance from the epipolar line that a small change of the relative
    pose explains; what noise alone would pretend is taken off."""
    noise_px: float
    """Robust standard deviation of what it does not explain."""
    sigma_px: float
    """Standard deviation of `drift_px`, if the sightings err independently."""
    elsewhere_px: float | None = None
    """The same change's root mean square over other places; None if none were asked for."""
    elsewhere_sigma_px: float = 0.0


class EpipolarPair:
    """Two calibrated cameras, as seen by their essential matrix."""

    def __init__(self, first: Camera, second: Camera) -> None:
        """Raises CalibrationError if both stand in one place."""
        T_first_world = first.T_world_camera
        self._R = T_first_world[:3, :3].T @ second.T_world_camera[:3, :3]
        baseline = T_first_world[:3, :3].T @ (second.position_world_m - first.position_world_m)
        length_m = float(np.linalg.norm(baseline))
        if length_m < 1e-6:
            raise CalibrationError("the cameras stand in one place: no epipolar lines", got=f"{length_m:g} m apart")
        self._t = baseline / length_m
        across = np.linalg.svd(self._t[None])[2]
        self._across = across[1:]
        self._first, self._second = first, second

    def residuals_px(self, first_px: ArrayLike, second_px: ArrayLike) -> Array:
        """(N,) signed distances of pixels (N, 2) from the other camera's epipolar lines, root mean square of both
        pictures; nan where no ray leads.
        """
        return self._residuals_and_slopes(first_px, second_px)[0]

    def slopes_px(self, ps_world_m: ArrayLike) -> Array:
        """(N, 5) by how much small changes of the relative pose move the pictures of points (N, 3) off their lines."""
        first_px, second_px = (camera.project(ps_world_m) for camera in (self._first, self._second))
        return self._residuals_and_slopes(first_px, second_px)[1]

    def fit(self, first_px: ArrayLike, second_px: ArrayLike, elsewhere: Array | None = None) -> EpipolarDrift:
        """The drift that the sightings (N, 2) of both cameras show together; strays are outvoted.

        `elsewhere` are the `slopes_px` of other places, of which it is also said how far they are off.

        Raises:
            CalibrationError: with no more sightings than unknowns.
        """
        residuals, slopes = self._residuals_and_slopes(first_px, second_px)
        known = np.isfinite(residuals)
        residuals, slopes = residuals[known], slopes[known]
        if len(residuals) <= UNKNOWNS:
            raise CalibrationError("too few sightings", expected=f"more than {UNKNOWNS}", got=len(residuals))
        step, sigma, weights = _explain(residuals, slopes, 0.0)
        noise_of_mean = UNKNOWNS * sigma**2 / float(weights.sum())
        mean_square = float(np.mean(np.square(slopes @ step)))
        drift_px, sigma_px = float(np.sqrt(max(mean_square - noise_of_mean, 0.0))), float(np.sqrt(noise_of_mean))
        if elsewhere is None:
            return EpipolarDrift(drift_px, sigma, sigma_px)
        step, spread, weights = _explain(residuals, slopes, 1 / LIKELY_TURN**2)
        inverse = np.linalg.inv(_squares(slopes, weights) + spread**2 / LIKELY_TURN**2 * np.eye(UNKNOWNS))
        noise_there = spread**2 * float(np.mean(np.einsum("ij,jk,ik->i", elsewhere, inverse, elsewhere)))
        mean_square = float(np.mean(np.square(elsewhere @ step)))
        there_px = float(np.sqrt(max(mean_square - noise_there, 0.0)))
        return EpipolarDrift(drift_px, sigma, sigma_px, there_px, float(np.sqrt(noise_there)))

    def _residuals_and_slopes(self, first_px: ArrayLike, second_px: ArrayLike) -> tuple[Array, Array]:
        """(N,) residuals, and (N, 5) how a rotation of the second camera and the baseline's direction change them."""
        x1 = _rays(self._first, first_px)
        x2 = _rays(self._second, second_px)
        y2 = x2 @ self._R.T
        values = np.einsum("ij,ij->i", x1, np.cross(self._t, y2))
        line1 = _per_pixel(np.cross(self._t, y2)[:, :2], self._first, x1)
        line2 = _per_pixel((np.cross(x1, self._t) @ self._R)[:, :2], self._second, x2)
        scale = np.sqrt((np.square(line1).sum(axis=1) + np.square(line2).sum(axis=1)) / 2)
        turned = x1 * (y2 @ self._t)[:, None] - self._t * np.einsum("ij,ij->i", x1, y2)[:, None]
        shifted = np.cross(y2, x1) @ self._across.T
        with np.errstate(invalid="ignore", divide="ignore"):
            return values / scale, np.hstack([turned, shifted]) / scale[:, None]


def _explain(residuals: Array, slopes: Array, precision: float) -> tuple[Array, float, Array]:
    """(5,) the change of pose, the robust sigma of what it leaves, and (N,) Huber's weights.

    `precision` is what is known of the change beforehand, one over its variance.
    """
    left, step, sigma = residuals, np.zeros(UNKNOWNS), 0.0
    weights = np.ones(len(residuals))
    for _ in range(ROUNDS):
        sigma = max(1.4826 * float(np.median(np.abs(left))), MIN_SIGMA_PX)
        weights = 1 / np.maximum(np.abs(left) / (HUBER_SIGMAS * sigma), 1.0)
        if precision:
            whole = _squares(slopes, weights) + sigma**2 * precision * np.eye(UNKNOWNS)
            step = np.linalg.solve(whole, slopes.T @ (weights * residuals))
        else:
            root = np.sqrt(weights)
            step = np.linalg.lstsq(slopes * root[:, None], residuals * root, rcond=1e-6)[0]
        left = residuals - slopes @ step
    return np.asarray(step, np.float64), sigma, np.asarray(weights, np.float64)


def _squares(slopes: Array, weights: Array) -> Array:
    return np.asarray(slopes.T @ (slopes * weights[:, None]), np.float64)


def _per_pixel(slopes: Array, camera: Camera, rays: Array) -> Array:
    """(N, 2) slopes along the pinhole coordinates of rays (N, 3), along the pixels.

    A pinhole's distortion, of some percent, changes nothing that a drift is judged by; a fisheye lens squeezes the rim
    of its picture several times.
    """
    if camera.model == "pinhole":
        return slopes / np.diag(camera.K)[:2]
    moved = camera.pixel_slopes(rays[:, :2])
    (xx, xy), (yx, yy) = moved.transpose(1, 2, 0)
    x, y = slopes.T
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.column_stack([x * yy - y * yx, y * xx - x * xy]) / (xx * yy - xy * yx)[:, None]


def _rays(camera: Camera, uvs_px: ArrayLike) -> Array:
    """(N, 3) rays in the camera's frame, z = 1."""
    xys = camera.undistort(np.asarray(uvs_px, np.float64).reshape(-1, 2))
    return np.column_stack([xys, np.ones(len(xys))])
