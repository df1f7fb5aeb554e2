"""Bundle adjustment of n cameras that saw one moving body: poses, clocks with drift, lenses where asked.

The body (a ball, a wand, a board) has a pose of its own at each instant. It is eliminated: for given cameras each
instant has one best pose, and its rows of the Jacobian are projected onto what that pose cannot explain. What is left
for `least_squares` is small and dense (some 8 unknowns a camera), whatever the number of instants, and the normal
matrix is that of the sparse whole problem, so covariances come out of it directly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from core.cameras.calibration.body_tracks import BodyTracks, Samples
from core.cameras.calibration.triangulation import NEAREST, inverses, points_of
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.geometry import make_transform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

UNKNOWNS: Final = ("rx", "ry", "rz", "x", "y", "z", "offset_ms", "drift_ppm", "focal", "cx", "cy", "k1", "k2")
"""Unknowns of a camera: a small rotation about its own axes (rad), position, clock, then the lens: a relative change of
the focal length, the principal point in 1000 px, and the first two coefficients."""
SIZE: Final = len(UNKNOWNS)
POSITION: Final = slice(3, 6)
CLOCK: Final = slice(6, 8)
LENS: Final = slice(8, SIZE)
PRIORS: Final = {"drift_ppm": 100.0, "focal": 0.02, "cx": 0.02, "cy": 0.02, "k1": 0.1, "k2": 0.2}
"""Standard deviations of what is believed beforehand: of quartz clocks, and of lenses from a board."""
LEAD_SIGMA_PX: Final = 5.0
"""What is believed of the lead beforehand: little, but where all move alike nothing else fixes it."""
BLOCK_US: Final = 100_000
"""Errors of detections within so long a time go together; standard deviations take them as one."""
OUTLIER_SIGMAS: Final = 4.0
WORST_PX: Final = 5.0
"""Noise above which the cameras cannot have seen one thing: detectors have 0.3 to 2 px."""
BODY_ROUNDS: Final = 2
ROUNDS: Final = 40
STEP: Final = 1e-6
FLAT: Final = 1e-10
"""Share of the largest eigenvalue below which a body's turn is not fixed, such as that of a wand about itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """C cameras in a common frame."""

    cameras: tuple[Camera, ...]
    offsets_us: Array
    """(C,) a camera's clock minus the first one's, in the middle of the sweep."""
    drifts_ppm: Array
    """(C,) how much faster it runs than the first one's."""
    lead_px: float = 0.0
    """How far all detections run ahead of the ball along its motion in the picture. A part of it that grows with the
    speed is the same as a later time of everything and is not in it."""

    @property
    def poses(self) -> Array:
        """(C, 4, 4): `T_frame_camera` of each camera."""
        return np.stack([camera.T_world_camera for camera in self.cameras])

    @property
    def baseline(self) -> float:
        """Distance of the first two cameras, in the frame's unit."""
        return float(np.linalg.norm(self.cameras[1].position_world_m - self.cameras[0].position_world_m))

    @property
    def focals_px(self) -> Array:
        """(C,) pixels per unit of the pinhole coordinates."""
        return np.array([(camera.K[0, 0] + camera.K[1, 1]) / 2 for camera in self.cameras])


Extra = Callable[[Rig], Array]
"""Further residuals of a rig, in standard deviations: clicked corners, a known length."""


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """The best rig and how well it is known."""

    rig: Rig
    covariance: Array
    """(13 C + 1, 13 C + 1) of UNKNOWNS by camera and the lead; 0 for what was held."""
    sigma_px: float
    """Standard deviation of a sighting along one picture axis (of one whose relative sigma is 1)."""
    t_us: Array
    """(G,) common instants."""
    used: Mask
    """(G, K, C) sightings that were not left out; (G * M, 1, C) where M markers are points of their own."""


@dataclass(frozen=True, slots=True, eq=False)
class BodyFit:
    """Where the body was, and what is left."""

    points: Array
    """(G, K, 3) its points in the frame; nan where it is not known."""
    errors_px: Array
    """(G, K, C, 2) seen minus projected; nan where not seen or not used."""
    slopes: Array
    """(G, K * C * 2, B) of the errors by the body's place and turn (B = 3 for a ball, else 6); 0 where no error."""
    samples: Samples


def adjust_rig(
    tracks: BodyTracks, rig: Rig, t_us: Array, free: Mask, extra: Extra, *, rough_px: float | None = None
) -> Adjusted:
    """The rig with the smallest residuals at common times, outliers left out.

    Args:
        tracks: what each camera saw of the body, px.
        rig: where to begin: poses, lenses, clocks.
        t_us: (G,) common instants.
        free: (13 C + 1,) which unknowns may change: 13 of each camera, and the lead of a detector.
        extra: residuals beside the sightings, such as a baseline of 1.
        rough_px: width of a robust loss for a rig that is only a guess; None: it is good already.

    Raises:
        CalibrationError: if less than half of the sightings fit.
    """

    def seen() -> Samples:
        return tracks.sample(t_us, rig.offsets_us, rig.drifts_ppm)

    every = np.ones(seen().uvs_px.shape[:3], np.bool_)
    if rough_px is not None:
        rig = _solve(seen(), rig, every, free, extra, sigma_px=rough_px, loss="cauchy")
    used, sigma_px = _inliers(seen(), rig, every)
    # Outliers depend on the rig and the rig on them: judged anew among all sightings, until nothing changes.
    for _ in range(2):
        rig = _solve(seen(), rig, used, free, extra, sigma_px=sigma_px, loss="linear")
        before = used
        used, sigma_px = _inliers(seen(), rig, every)
        if np.array_equal(before, used):
            break
    here, slopes = _residuals_and_jacobian(seen(), rig, used, free, extra, sigma_px)
    # What may not change is exact: rows of zeros.
    full = np.zeros((free.size, free.size))
    places = np.flatnonzero(free)
    full[np.ix_(places, places)] = blocked_covariance(slopes, here, seen().t_us, used.size * 2)
    return Adjusted(rig, full, sigma_px, t_us, used)


def blocked_covariance(slopes: Array, here: Array, t_us: Array, rows: int) -> Array:
    """Covariance of the unknowns (P, P) at the best fit: errors within a block of time count as one.

    `slopes` (R, P) and `here` (R,) are Jacobian and residuals in standard deviations; the first `rows` of them belong
    to the instants `t_us` (N,), as many to each, the others are known lengths and clicks with errors of their own.

    Args:
        slopes: (R, P) Jacobian.
        here: (R,) residuals.
        t_us: (N,) times of the instants.
        rows: number of residuals that belong to the instants.
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


def fit_body(samples: Samples, rig: Rig, used: Mask) -> BodyFit:
    """The body where the used sightings (G, K, C) of it fit best, by a given rig."""
    samples = samples.by_clocks(rig.offsets_us, rig.drifts_ppm)
    uvs = samples.uvs_px - rig.lead_px * samples.directions
    uvs = np.where(used[..., None], uvs, np.nan)
    flat = uvs.reshape(-1, len(rig.cameras), 2)
    xys = np.stack([camera.undistort(flat[:, c]) for c, camera in enumerate(rig.cameras)], axis=1)
    points = points_of(rig.poses, xys, rig.focals_px).reshape(*uvs.shape[:2], 3)
    if len(samples.body_m) == 1:
        arms, middle = np.zeros_like(points), points[:, 0]
    else:
        arms, middle = _placed(samples.body_m, points)
    for _ in range(BODY_ROUNDS):
        errors, slopes = _errors(rig, middle[:, None] + arms, arms, uvs, samples.sigmas)
        step = -(_pinv(slopes) @ _rows(errors, samples.sigmas)[..., None])[..., 0]
        middle = middle + step[:, :3]
        if slopes.shape[2] > 3:
            arms = arms @ Rotation.from_rotvec(step[:, 3:]).as_matrix().transpose(0, 2, 1)
    errors, slopes = _errors(rig, middle[:, None] + arms, arms, uvs, samples.sigmas)
    return BodyFit(middle[:, None] + arms, errors, slopes, samples)


def _placed(body_m: Array, points: Array) -> tuple[Array, Array]:
    """Arms (G, K, 3) and middles (G, 3) of the rigid body nearest to points (G, K, 3), some of them nan."""
    there = np.isfinite(points[..., :1])
    count = there.sum(axis=1)
    enough = count[:, 0] >= min(len(body_m), 2 if np.linalg.matrix_rank(body_m - body_m[0], tol=1e-9) < 2 else 3)
    weight = there / np.maximum(count, 1)[:, None]
    middle, own = np.nansum(points * weight, axis=1), (body_m * weight).sum(axis=1)
    moment = np.einsum("gki,gkj->gij", np.where(there, points - middle[:, None], 0.0), body_m - own[:, None])
    U, _, Vt = np.linalg.svd(moment)
    U[..., -1] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))[:, None]
    arms = (body_m - own[:, None]) @ (U @ Vt).transpose(0, 2, 1)
    arms[~enough], middle[~enough] = np.nan, np.nan
    return arms, middle


def _errors(rig: Rig, ps: Array, arms: Array, uvs: Array, sigmas: Array) -> tuple[Array, Array]:
    """Seen minus projected (G, K, C, 2), and its slopes (G, K * C * 2, B) by the body, over the relative sigmas."""
    instants, count, cameras = uvs.shape[:3]
    size = 3 if count == 1 else 6
    errors, slopes = np.full(uvs.shape, np.nan), np.zeros((*uvs.shape, size))
    for c, camera in enumerate(rig.cameras):
        by_local, projected = _projection(camera, camera.to_camera(ps.reshape(-1, 3)))
        errors[:, :, c] = uvs[:, :, c] - projected.reshape(instants, count, 2)
        by_point = -(by_local @ camera.T_world_camera[:3, :3].T).reshape(instants, count, 2, 3)
        slopes[:, :, c, :, :3] = by_point
        if size > 3:
            slopes[:, :, c, :, 3:] = -by_point @ _cross(arms)
    slopes[~np.isfinite(errors)] = 0.0
    return errors, (slopes / sigmas[..., None, None]).reshape(instants, count * cameras * 2, size)


def _projection(camera: Camera, local: Array) -> tuple[Array, Array]:
    """Slopes (N, 2, 3) of the pixel by points (N, 3) before a camera, and the pixels (N, 2); nan behind it."""
    z = np.where(local[:, 2] > NEAREST, local[:, 2], np.nan)
    xys = local[:, :2] / z[:, None]
    by_xy = camera.pixel_slopes(xys)
    by_local = np.zeros((len(local), 2, 3))
    by_local[:, [0, 1], [0, 1]] = (1 / z)[:, None]
    by_local[:, :, 2] = -xys / z[:, None]
    return by_xy @ by_local, camera.project_from_camera(local)


def _cross(v: Array) -> Array:
    """(..., 3, 3) so that `_cross(v) @ w` is v x w."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, axis=-1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], axis=-2)


def _rows(errors: Array, sigmas: Array) -> Array:
    """(G, K * C * 2) errors over their relative sigmas, 0 where none."""
    return np.nan_to_num(errors / sigmas[..., None]).reshape(len(errors), -1)


def _pinv(slopes: Array) -> Array:
    """(G, B, rows) pseudo-inverses; directions that nothing fixes stay as they are."""
    turned = slopes.transpose(0, 2, 1)
    if slopes.shape[2] == 3:
        return inverses(turned @ slopes) @ turned
    return np.linalg.pinv(turned @ slopes, rcond=FLAT, hermitian=True) @ turned


def _by_cameras(rig: Rig, fit: BodyFit, free: Mask) -> Array:
    """(G, K * C * 2, F) slopes of the errors by the free unknowns, the body held."""
    instants, count, cameras = fit.errors_px.shape[:3]
    column = np.cumsum(free) - 1
    slopes = np.zeros((*fit.errors_px.shape, int(free.sum())))
    since_us = fit.samples.since_us[:, None, None]
    for c, camera in enumerate(rig.cameras):
        local = camera.to_camera(fit.points.reshape(-1, 3))
        by_local, projected = _projection(camera, local)
        own = np.zeros((len(local), 2, SIZE))
        own[:, :, :3] = -by_local @ _cross(local)
        own[:, :, POSITION] = by_local @ camera.T_world_camera[:3, :3].T
        own = own.reshape(instants, count, 2, SIZE)
        own[..., 6] = 1e3 * fit.samples.speeds[:, :, c]
        own[..., 7] = 1e-6 * since_us * fit.samples.speeds[:, :, c]
        for unknown in range(SIZE)[LENS]:
            if free[c * SIZE + unknown]:
                moved = _lens(camera, STEP * np.eye(SIZE)[unknown]).project_from_camera(local)
                own[..., unknown] = ((projected - moved) / STEP).reshape(instants, count, 2)
        mine = free[c * SIZE : (c + 1) * SIZE]
        slopes[:, :, c][..., column[c * SIZE : (c + 1) * SIZE][mine]] = own[..., mine]
    if free[-1]:
        slopes[..., -1] = -fit.samples.directions
    slopes[~np.isfinite(fit.errors_px)] = 0.0
    return (slopes / fit.samples.sigmas[..., None, None]).reshape(instants, count * cameras * 2, -1)


def _residuals_and_jacobian(
    samples: Samples, rig: Rig, used: Mask, free: Mask, extra: Extra, sigma_px: float
) -> tuple[Array, Array]:
    """All residuals (R,) in standard deviations and their slopes (R, F), the body eliminated."""
    fit = fit_body(samples, rig, used)
    by_cameras = _by_cameras(rig, fit, free)
    by_cameras -= fit.slopes @ (_pinv(fit.slopes) @ by_cameras)
    count = int(free.sum())
    more = _prior_residuals(rig, rig, free, extra)
    steps = [
        (_prior_residuals(moved_rig(rig, free, row), rig, free, extra, row) - more) / STEP
        for row in STEP * np.eye(count)
    ]
    here = np.concatenate([_rows(fit.errors_px, fit.samples.sigmas).ravel() / sigma_px, more])
    return here, np.vstack([by_cameras.reshape(-1, count) / sigma_px, np.column_stack(steps)])


def _prior_residuals(moved: Rig, start: Rig, free: Mask, extra: Extra, step: Array | None = None) -> Array:
    """The extra residuals, and the priors: of the lens about where it started, of drift and lead about 0."""
    full = np.zeros(free.size)
    if step is not None:
        full[free] = step
    rows = [extra(moved), moved.drifts_ppm / PRIORS["drift_ppm"], np.array([moved.lead_px / LEAD_SIGMA_PX])]
    by_camera = full[:-1].reshape(-1, SIZE)
    sigmas = np.array([PRIORS[name] for name in UNKNOWNS[LENS]])
    return np.concatenate([*rows, (by_camera[:, LENS] / sigmas).ravel()])


def _solve(samples: Samples, rig: Rig, used: Mask, free: Mask, extra: Extra, *, sigma_px: float, loss: str) -> Rig:
    def residuals(step: Array) -> Array:
        moved = moved_rig(rig, free, step)
        fit = fit_body(samples, moved, used)
        more = _prior_residuals(moved, rig, free, extra, step)
        return np.concatenate([_rows(fit.errors_px, fit.samples.sigmas).ravel() / sigma_px, more])

    def slopes(step: Array) -> Array:
        # Turns are small steps from where they are, so the slopes there are those from 0 but for a second order.
        return _residuals_and_jacobian(samples, moved_rig(rig, free, step), used, free, extra, sigma_px)[1]

    method: Any = slopes  # scipy's annotations of `jac` know only names
    start = np.zeros(int(free.sum()))
    with threadpool_limits(1):  # of some 20 columns: several threads only wait for each other on a busy machine
        found = least_squares(residuals, start, jac=method, loss=loss, x_scale="jac", max_nfev=ROUNDS, xtol=1e-10)
    return moved_rig(rig, free, found.x)


def moved_rig(rig: Rig, free: Mask, step: Array) -> Rig:
    """The rig with its free unknowns changed by `step` (F,)."""
    full = np.zeros(len(free))
    full[free] = step
    rows = full[:-1].reshape(-1, SIZE)
    turns = Rotation.from_rotvec(rows[:, :3]).as_matrix()
    cameras = []
    for camera, turn, row in zip(rig.cameras, turns, rows, strict=True):
        T = camera.T_world_camera
        cameras.append(
            replace(_lens(camera, row), T_world_camera=make_transform(T[:3, :3] @ turn, T[:3, 3] + row[3:6]))
        )
    offsets_us, drifts_ppm = rig.offsets_us + 1e3 * rows[:, 6], rig.drifts_ppm + rows[:, 7]
    return Rig(tuple(cameras), offsets_us, drifts_ppm, rig.lead_px + float(full[-1]))


def _lens(camera: Camera, row: Array) -> Camera:
    if not row[LENS].any():
        return camera
    K, distortion = camera.K.copy(), camera.distortion.copy()
    K[[0, 1], [0, 1]] *= 1 + row[8]
    K[:2, 2] += 1e3 * row[9:11]
    distortion[:2] += row[11:13]
    return replace(camera, K=K, distortion=distortion)


def _inliers(samples: Samples, rig: Rig, every: Mask) -> tuple[Mask, float]:
    """Sightings (G, K, C) whose residuals are no larger than noise makes them, and the noise of one.

    Where an instant does not fit, its worst sighting is left out, again and again while two cameras are left that see
    the point; two cameras that contradict each other are left out both.
    """
    body_m = samples.body_m
    # Unknowns of a body's pose: a point has no orientation, a wand none about its own axis.
    size = 3 if len(body_m) == 1 else 5 if np.linalg.matrix_rank(body_m, tol=1e-9) < 2 else 6
    used = every.copy()
    fit = _BodyErrors.of(samples, rig, used, size)
    start = int(fit.whole.sum())
    if not start:
        raise CalibrationError("no sighting is left that fits", remedy="check the lenses and the detections")
    # 1.4826: standard deviation of a normal distribution over the median of its absolute values.
    sigma = 1.4826 * float(np.median(fit.chi[fit.whole]))
    if sigma > WORST_PX:
        raise _misfit(sigma)
    limit = OUTLIER_SIGMAS * max(sigma, 1e-6)
    for _ in range(2 * len(rig.cameras)):
        used &= fit.seen & fit.whole[:, None, None]
        bad = np.flatnonzero(fit.whole & (fit.chi > limit))
        if not len(bad):
            break
        worst = np.argmax(np.where(fit.seen, fit.sizes, -1.0)[bad].reshape(len(bad), -1), axis=1)
        k, c = np.divmod(worst, len(rig.cameras))
        pair = fit.seen[bad, k].sum(axis=1) <= 2
        used[bad, k, c] = False
        used[bad[pair], k[pair]] = False
        fit = _BodyErrors.of(samples, rig, used, size)
    used &= (fit.whole & (fit.chi <= limit))[:, None, None]
    good = used.any(axis=(1, 2))
    if good.sum() < 0.5 * start:
        raise _misfit(sigma)
    squares = np.square(fit.chi[good]) * fit.freedom[good]
    return used, max(float(np.sqrt(squares.sum() / fit.freedom[good].sum())), 1e-6)


@dataclass(frozen=True, slots=True, eq=False)
class _BodyErrors:
    """Sizes of the errors of used sightings, and how well each instant fits."""

    sizes: Array
    """(G, K, C) px over the relative sigma; nan where none."""
    freedom: Array
    """(G,) rows beyond the body's own unknowns."""
    whole: Mask
    """(G,) two cameras see a point, and something is left over to fit."""
    chi: Array
    """(G,) root of the squares over the freedom."""

    @property
    def seen(self) -> Mask:
        """(G, K, C)."""
        return np.isfinite(self.sizes)

    @staticmethod
    def of(samples: Samples, rig: Rig, used: Mask, size: int) -> _BodyErrors:
        """The errors of the best body; `size` is the number of its unknowns."""
        fit = fit_body(samples, rig, used)
        sizes = np.linalg.norm(fit.errors_px, axis=3) / fit.samples.sigmas
        seen = np.isfinite(sizes)
        freedom = np.maximum(2 * seen.sum(axis=(1, 2)) - size, 0)
        whole = np.asarray((seen.sum(axis=2) >= 2).any(axis=1) & (freedom > 0))
        return _BodyErrors(sizes, freedom, whole, np.sqrt(np.nansum(sizes**2, axis=(1, 2)) / np.maximum(freedom, 1)))


def _misfit(sigma: float) -> CalibrationError:
    return CalibrationError(
        "the sightings do not fit together",
        expected=f"errors up to {WORST_PX:g} px",
        got=f"{sigma:.1f} px in the middle",
        remedy="check the lenses, the detections, the wand, and that --max-offset-ms covers the clocks' difference",
    )
