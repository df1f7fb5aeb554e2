"""Bundle adjustment of cameras that saw one swept point: poses and clock offsets, the points eliminated.

For given cameras each point has one best position, found by itself; what is left of its residuals depends on the
cameras alone. So the problem keeps 7 unknowns per camera whatever the number of points, is dense, and its Jacobian's
normal matrix is that of the full problem with the points eliminated: standard deviations come out of it directly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from core.errors import CalibrationError

Array = NDArray[np.float64]

POSE: Final = 6
"""Unknowns of a camera's pose: a small rotation about its own axes, and its position."""
INNER_ROUNDS: Final = 1
"""Newton steps of a point from where its rays come nearest to each other: what is left after one does not count."""
BLOCK_US: Final = 100_000
"""Errors of detections within so long a time go together; standard deviations take them as one."""
PARALLEL: Final = 1e-10
"""Determinant of the normal equations below which rays do not meet."""
SINGULAR: Final = 1e-12
"""Determinant over the cubed trace below which a point's place along its rays is not fixed."""
NEAREST: Final = 1e-6
"""Depth in front of a camera."""
OUTLIER_SIGMAS: Final = 4.0
LEAD_SIGMA_PX: Final = 5.0
"""What is believed of the lead beforehand: little, but where all move alike nothing else fixes it."""
WORST_PX: Final = 5.0
"""Noise above which the cameras cannot have seen one thing: detectors have 0.3 to 2 px."""
REFITS: Final = 2
ROUNDS: Final = 30
STEP: Final = 1e-6
"""Step of the numerical derivatives: radians, positions and milliseconds are all of the order of 1."""


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """C cameras in a frame of their own choice."""

    Rs: Array
    """(C, 3, 3): R_frame_camera."""
    ps: Array
    """(C, 3): optical centres."""
    offsets_us: Array
    """(C,): a camera's clock minus the first one's; 0 for the first."""
    lead_px: float = 0.0
    """How far all detections run ahead of the ball along its motion in the picture. A part of it that grows with the
    speed is the same as a later time of everything and is not in it."""


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Common instants and what the cameras saw then."""

    t_us: Array
    """(N,) on the first camera's clock."""
    sample: Callable[[Array, float], Array]
    """From offsets (C,) and a lead to the pinhole coordinates (N, C, 2), nan where not seen."""
    focals_px: Array
    """(C,): turns pinhole coordinates into pixels."""

    def rows(self, keep: NDArray[np.bool_]) -> Sightings:
        """Some of the instants."""
        return replace(self, t_us=self.t_us[keep], sample=lambda *of_rig: self.sample(*of_rig)[keep])

    def of(self, rig: Rig) -> Array:
        """The pinhole coordinates (N, C, 2) that a rig's clocks and lead make of them."""
        return self.sample(rig.offsets_us, rig.lead_px)


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """The best rig and how well it is known."""

    rig: Rig
    covariance: Array
    """(7 C + 1, 7 C + 1): per camera rotation (rad), position, offset (ms), then the lead; 0 for what was held."""
    sigma_px: float
    """Standard deviation of a sighting along one picture axis."""
    used: NDArray[np.bool_]
    """(N,) instants that were not left out."""


Extra = Callable[[Rig], Array]
"""Further residuals of a rig, in standard deviations: clicked corners, a known length."""


def adjust(
    sightings: Sightings, rig: Rig, free: NDArray[np.bool_], extra: Extra, *, rough_px: float | None = None
) -> Adjusted:
    """The rig with the smallest residuals, outliers left out; `free` (7 C + 1,) says what may change.

    `rough_px` is how well the sightings fit a rig that is only a guess: it is first improved with a robust loss of that
    width. Without it the rig is near enough to tell outliers at once.

    Raises:
        CalibrationError: if less than half of the sightings fit.
    """
    if rough_px is not None:
        rig = _solve(sightings, rig, free, extra, sigma_px=rough_px, loss="cauchy")
    used, sigma_px = _inliers(sightings, rig)
    for _ in range(REFITS):
        rig = _solve(sightings.rows(used), rig, free, extra, sigma_px=sigma_px, loss="linear")
        before = used
        used, sigma_px = _inliers(sightings, rig)
        if np.array_equal(before, used):
            break
    return Adjusted(rig, _covariance(sightings.rows(used), rig, free, extra, sigma_px), sigma_px, used)


def points_of(rig: Rig, xys: Array, focals_px: Array) -> Array:
    """The points (N, 3) with the smallest reprojection errors; nan with fewer than two sightings (N, C, 2)."""
    normal, right = np.zeros((len(xys), 3, 3)), np.zeros((len(xys), 3))
    seen = np.isfinite(xys[..., 0])
    for c in range(len(rig.ps)):
        rays = np.column_stack([xys[:, c], np.ones(len(xys))]) @ rig.Rs[c].T
        rays[~seen[:, c]] = np.nan
        rays /= np.sqrt((rays * rays).sum(axis=1, keepdims=True))
        across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
        across[~seen[:, c]] = 0.0
        normal += across
        right += across @ rig.ps[c]
    bad = (seen.sum(axis=1) < 2) | ~(_determinants(normal) > PARALLEL)
    normal[bad], right[bad] = np.eye(3), np.nan
    ps: Array = np.asarray(np.linalg.solve(normal, right[..., None])[..., 0], np.float64)
    for _ in range(INNER_ROUNDS):
        slopes = np.nan_to_num(_slopes(rig, ps, xys, focals_px)).reshape(len(ps), -1, 3)
        errors = np.nan_to_num(_errors(rig, ps, xys, focals_px)).reshape(len(ps), -1, 1)
        turned = slopes.transpose(0, 2, 1)
        hessian = turned @ slopes
        size = np.trace(hessian, axis1=1, axis2=2) ** 3
        hessian[~(_determinants(hessian) > SINGULAR * size)] = np.eye(3)  # not in front of two cameras
        ps += np.linalg.solve(hessian, turned @ errors)[..., 0]
    return ps


def residuals_px(rig: Rig, xys: Array, focals_px: Array) -> Array:
    """(N, C, 2) seen minus projected best point, in pixels; nan where not seen."""
    return _errors(rig, points_of(rig, xys, focals_px), xys, focals_px)


def point_information(rig: Rig, ps: Array, xys: Array, focals_px: Array, sigma_px: float) -> Array:
    """(N, 3, 3) inverse covariances of points seen in pixels that err by `sigma_px`; nan where a point is none."""
    slopes = np.nan_to_num(_slopes(rig, ps, xys, focals_px)).reshape(len(ps), -1, 3) / sigma_px
    information = slopes.transpose(0, 2, 1) @ slopes
    information[~np.isfinite(ps).all(axis=1)] = np.nan
    return information


def _errors(rig: Rig, ps: Array, xys: Array, focals_px: Array) -> Array:
    """(N, C, 2) seen minus projected, in pixels; nan where not seen or not in front."""
    errors = np.empty_like(xys)
    for c in range(len(rig.ps)):
        local = (ps - rig.ps[c]) @ rig.Rs[c]
        z = np.where(local[:, 2] > NEAREST, local[:, 2], np.nan)
        errors[:, c] = (xys[:, c] - local[:, :2] / z[:, None]) * focals_px[c]
    return errors


def _slopes(rig: Rig, ps: Array, xys: Array, focals_px: Array) -> Array:
    """(N, C, 2, 3) of the projection in pixels by the point; nan where not seen or not in front."""
    slopes = np.empty((*xys.shape, 3))
    for c in range(len(rig.ps)):
        local = (ps - rig.ps[c]) @ rig.Rs[c]
        z = np.where((local[:, 2] > NEAREST) & np.isfinite(xys[:, c, 0]), local[:, 2], np.nan)[:, None]
        for axis in (0, 1):
            slopes[:, c, axis] = (
                focals_px[c] / z * (rig.Rs[c][:, axis] - local[:, axis : axis + 1] / z * rig.Rs[c][:, 2])
            )
    return slopes


def _determinants(a: Array) -> Array:
    """Determinants of (N, 3, 3); numpy's own take five times as long over so small ones."""
    return (
        a[:, 0, 0] * (a[:, 1, 1] * a[:, 2, 2] - a[:, 1, 2] * a[:, 2, 1])
        - a[:, 0, 1] * (a[:, 1, 0] * a[:, 2, 2] - a[:, 1, 2] * a[:, 2, 0])
        + a[:, 0, 2] * (a[:, 1, 0] * a[:, 2, 1] - a[:, 1, 1] * a[:, 2, 0])
    )


def _solve(sightings: Sightings, rig: Rig, free: NDArray[np.bool_], extra: Extra, *, sigma_px: float, loss: str) -> Rig:
    def residuals(step: Array) -> Array:
        return _residuals(sightings, _moved(rig, free, step), extra, sigma_px)

    def slopes(step: Array) -> Array:
        here = residuals(step)
        return np.column_stack([(residuals(step + row) - here) / STEP for row in STEP * np.eye(len(step))])

    start = np.zeros(int(free.sum()))
    # scipy's own differences are relative, and the unknowns begin at 0. Its annotations of `jac` know only names.
    method: Any = slopes
    found = least_squares(residuals, start, jac=method, loss=loss, x_scale="jac", max_nfev=ROUNDS)
    return _moved(rig, free, found.x)


def _residuals(sightings: Sightings, rig: Rig, extra: Extra, sigma_px: float) -> Array:
    errors = residuals_px(rig, sightings.of(rig), sightings.focals_px) / sigma_px
    return np.concatenate([np.nan_to_num(errors).ravel(), extra(rig), [rig.lead_px / LEAD_SIGMA_PX]])


def _moved(rig: Rig, free: NDArray[np.bool_], step: Array) -> Rig:
    full = np.zeros(len(free))
    full[free] = step
    of_cameras = full[:-1].reshape(-1, POSE + 1)
    turns = Rotation.from_rotvec(of_cameras[:, :3]).as_matrix()
    offsets_us = rig.offsets_us + 1e3 * of_cameras[:, POSE]
    return Rig(rig.Rs @ turns, rig.ps + of_cameras[:, 3:POSE], offsets_us, rig.lead_px + float(full[-1]))


def _inliers(sightings: Sightings, rig: Rig) -> tuple[NDArray[np.bool_], float]:
    """Instants whose residuals are no larger than noise makes them, and the noise of one sighting."""
    errors = residuals_px(rig, sightings.of(rig), sightings.focals_px)
    seen = np.isfinite(errors[..., 0]).sum(axis=1)
    freedom = np.maximum(2 * seen - 3, 1)
    size = np.sqrt(np.nansum(errors**2, axis=(1, 2)) / freedom)
    whole = seen >= 2
    if not whole.any():
        raise CalibrationError("no sighting is left that fits", remedy="check the lenses and the detections")
    sigma = 1.4826 * float(np.median(size[whole]))
    used = whole & (size <= OUTLIER_SIGMAS * max(sigma, 1e-6))
    if sigma > WORST_PX or used.sum() < 0.5 * whole.sum():
        expected, got = f"errors up to {WORST_PX:g} px", f"{sigma:.1f} px in the middle"
        remedy = "check the lenses, the detections, and that --max-offset-ms covers the clocks' difference"
        raise CalibrationError("the sightings do not fit together", expected=expected, got=got, remedy=remedy)
    squares = np.nansum(errors[used] ** 2)
    return used, max(float(np.sqrt(squares / freedom[used].sum())), 1e-6)


def _covariance(sightings: Sightings, rig: Rig, free: NDArray[np.bool_], extra: Extra, sigma_px: float) -> Array:
    """Covariance of what is free, the errors within a block of time taken as one (a sandwich estimate)."""

    def residuals(step: Array) -> Array:
        return _residuals(sightings, _moved(rig, free, step), extra, sigma_px)

    count = int(free.sum())
    here = residuals(np.zeros(count))
    steps = STEP * np.eye(count)
    slopes = np.column_stack([(residuals(row) - residuals(-row)) / (2 * STEP) for row in steps])
    rows = len(sightings.t_us) * rig.ps.shape[0] * 2
    blocked = blocked_covariance(slopes, here, sightings.t_us, rows)
    full = np.zeros((free.size, free.size))
    places = np.flatnonzero(free)
    full[np.ix_(places, places)] = blocked
    return full


def blocked_covariance(slopes: Array, here: Array, t_us: Array, rows: int) -> Array:
    """Covariance of the unknowns (P, P) at the best fit: errors within a block of time count as one.

    `slopes` (R, P) and `here` (R,) are Jacobian and residuals in standard deviations; the first `rows` of them belong
    to the instants `t_us` (N,), as many to each, the others are known lengths and clicks with errors of their own.
    """
    count = slopes.shape[1]
    inverse = np.linalg.pinv(slopes.T @ slopes)
    scores = (slopes[:rows] * here[:rows, None]).reshape(len(t_us), -1, count).sum(axis=1)
    _, block = np.unique(t_us // BLOCK_US, return_inverse=True)
    sums = np.zeros((int(block.max(initial=0)) + 1, count))
    np.add.at(sums, block, scores)
    known = slopes[rows:].T @ slopes[rows:]  # clicks and lengths: their own noise is 1 and independent
    blocked = inverse @ (sums.T @ sums + known) @ inverse
    # With few blocks the sandwich is too small by chance; independent errors are the least there can be.
    stretch = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(blocked), 1e-300), 1.0))
    return blocked * stretch[:, None] * stretch
