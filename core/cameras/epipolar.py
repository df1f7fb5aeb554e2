"""How far two cameras' sightings are from their epipolar lines, and how much of that is a wrong relative pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras.camera import Camera
from core.errors import CalibrationError

Array = NDArray[np.float64]

UNKNOWNS: Final = 5
"""Numbers of a relative pose that pictures determine: three of the rotation, two of the direction of the baseline."""
ROUNDS: Final = 12
HUBER_SIGMAS: Final = 1.5
"""Sightings farther off than that pull no harder (Huber's weights)."""
MIN_SIGMA_PX: Final = 0.02
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
