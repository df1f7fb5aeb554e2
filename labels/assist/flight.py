"""Interpolation in 3D: one free flight, fitted to the labels of two or more cameras at once and projected back.

Gravity, air drag and a constant spin's side force (Magnus), integrated; ten unknowns: position, velocity, drag and the
three of the spin. The last four have priors, so that a few keyframes are enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera, StereoRig, ball_circles
from core.jit import njit
from core.table import GRAVITY_MPS2
from labels.arrays import LabelArrays
from labels.assist.curve import NOT_COVERED, Curve

Array = NDArray[np.float64]
STEP_S: Final = 4e-3
DRAG_PER_M: Final = 0.112
"""Half the density of air times drag coefficient 0.4 times cross section over mass of a 40 mm, 2.7 g ball."""
DRAG_SIGMA_PER_M: Final = 0.06
SPIN_SIGMA_PER_S: Final = 1.0
"""Side acceleration per velocity: fast topspin (100 turns a second) pulls with about one g at 10 m/s."""
MIN_PAIRS: Final = 4
WORST_RESIDUAL_PX: Final = 3.0
"""More than that is no free flight: a bounce or hit is in it, or the calibration is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedFlight:
    """A fitted flight between two breaks."""

    start_us: int
    end_us: int
    values: Array
    """(10,) position m, velocity m/s, drag 1/m, spin 1/s at `start_us`."""
    residual_px: float
    """Root mean square distance of the labels' coordinates from it."""

    def at(self, t_us: ArrayLike) -> Array:
        """(N, 3) world positions; before `start_us` with the acceleration that it has there."""
        t = _seconds(np.asarray(t_us, np.int64), self.start_us)
        before = np.minimum(t, 0.0)[..., None]
        acceleration = np.empty(3)
        _accelerate(self.values[3:6], self.values, GRAVITY_MPS2, acceleration)
        extrapolated = self.values[3:6] * before + 0.5 * acceleration * before**2
        return _positions(self.values[None], np.maximum(t, 0.0))[0] + extrapolated

    def seen_by(self, camera: Camera, t_us: ArrayLike) -> Array:
        """(N, 3) centre and radius in the picture."""
        circles = ball_circles(camera, self.at(t_us))
        return np.column_stack([circles.u_px, circles.v_px, circles.r_px])


def fit_flight(cameras: Sequence[Camera], labels: Sequence[LabelArrays]) -> FittedFlight | None:
    """The flight through the visible labels of two or more cameras, which must not contain a bounce or hit.

    Labels that only one camera has at their instant count too. None with fewer than `MIN_PAIRS` instants at which two
    cameras have labels, or where no flight fits.
    """
    given = [(camera, keys.rows(keys.seen)) for camera, keys in zip(cameras, labels, strict=True)]
    given = [(camera, keys) for camera, keys in given if len(keys)]
    if len(given) < 2:
        return None
    cameras, seen = zip(*given, strict=True)
    uvs = [np.column_stack([keys.x_px, keys.y_px]) for keys in seen]
    common, views = common_views([keys.t_us for keys in seen], uvs)
    if len(common) < MIN_PAIRS:
        return None
    points = StereoRig({str(row): camera for row, camera in enumerate(cameras)}).triangulate(views).ps_world_m
    start_us = int(min(keys.t_us[0] for keys in seen))
    end_us = int(max(keys.t_us[-1] for keys in seen))
    times = [_seconds(keys.t_us, start_us) for keys in seen]
    fine = np.isfinite(points).all(axis=1)
    if fine.sum() < MIN_PAIRS:
        return None
    # Labels mark the middle of an outline, which is not the projection of the ball's centre; the difference hardly
    # depends on what is fitted, and outlines are dear.
    guess = _first_guess(_seconds(common[fine], start_us), points[fine])

    targets = [
        uv - _outline_offset(camera, _positions(guess[None], t)[0])
        for camera, t, uv in zip(cameras, times, uvs, strict=True)
    ]

    def residuals(many: Array) -> Array:
        """(K, M) of K sets of values."""
        parts = []
        for camera, t, target in zip(cameras, times, targets, strict=True):
            found = camera.project(_positions(many, t).reshape(-1, 3)).reshape(len(many), len(t), 2)
            parts.append(np.nan_to_num(found - target, nan=1e3).reshape(len(many), -1))
        prior = np.column_stack([(many[:, 6] - DRAG_PER_M) / DRAG_SIGMA_PER_M, many[:, 7:] / SPIN_SIGMA_PER_S])
        return np.concatenate([*parts, prior], axis=1)

    def slopes(values: Array) -> Array:
        steps = np.diag([1e-5] * 3 + [1e-4] * 3 + [1e-4] * 4)
        both = residuals(np.concatenate([values + steps, values - steps]))
        return ((both[:10] - both[10:]) / (2 * np.diag(steps)[:, None])).T

    low = np.concatenate([np.full(3, -20.0), np.full(3, -40.0), [-0.02], np.full(3, -20.0)])
    high = np.concatenate([np.full(3, 20.0), np.full(3, 40.0), [0.5], np.full(3, 20.0)])
    if not ((low < guess) & (guess < high)).all():
        return None  # faster or farther than any ball
    from scipy.optimize import least_squares  # loaded late, because the app's page waits for this module

    fit = least_squares(
        lambda values: residuals(values[None])[0],
        guess,
        jac=slopes,  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        loss="soft_l1",
        x_scale="jac",
        max_nfev=20,
    )
    misses = residuals(fit.x[None])[0][:-4]
    residual_px = float(np.sqrt(np.mean(misses**2)))
    return FittedFlight(start_us, end_us, fit.x, residual_px) if residual_px <= WORST_RESIDUAL_PX else None


def common_views(t_us: Sequence[NDArray[np.int64]], uvs_px: Sequence[Array]) -> tuple[NDArray[np.int64], Array]:
    """The instants at which two or more of C tracks have a position, and these (N, C, 2); nan where a track has none.

    `t_us` are the ascending times of the tracks, `uvs_px` their positions (n, 2).
    """
    every = np.unique(np.concatenate(t_us))
    views = np.full((len(every), len(t_us), 2), np.nan)
    for camera, (own_us, uv) in enumerate(zip(t_us, uvs_px, strict=True)):
        views[np.searchsorted(every, own_us), camera] = uv
    shared = np.isfinite(views[:, :, 0]).sum(axis=1) >= 2
    return every[shared], views[shared]


def _outline_offset(camera: Camera, ps: Array) -> Array:
    circles = ball_circles(camera, ps)
    offset = np.column_stack([circles.u_px, circles.v_px]) - camera.project(ps)
    return np.where(np.isfinite(offset), offset, 0.0)


def _seconds(t_us: NDArray[np.int64], start_us: int) -> Array:
    return (t_us - start_us).astype(np.float64) * 1e-6


def _first_guess(t: Array, points: Array) -> Array:
    fallen = points + 0.5 * np.array([0, 0, GRAVITY_MPS2]) * t[:, None] ** 2
    line = np.linalg.lstsq(np.column_stack([np.ones(len(t)), t]), fallen, rcond=None)[0]
    return np.concatenate([line[0], line[1], [DRAG_PER_M, 0.0, 0.0, 0.0]])


def _positions(values: Array, t: Array) -> Array:
    """(K, N, 3) positions of K flights at N times: fourth-order Runge-Kutta, cubic interpolation between steps."""
    steps = int(np.ceil(max(float(np.max(t, initial=0.0)), STEP_S) / STEP_S))
    ps, vs = _integrate(np.ascontiguousarray(values), steps, STEP_S, GRAVITY_MPS2)
    k = np.clip((t / STEP_S).astype(np.intp), 0, steps - 1)
    s = (t / STEP_S - k)[None, :, None]
    a, b, c, d = ps[:, k], vs[:, k] * STEP_S, ps[:, k + 1], vs[:, k + 1] * STEP_S
    return a + s * b + s**2 * (3 * (c - a) - 2 * b - d) + s**3 * (2 * (a - c) + b + d)


@njit
def _integrate(values, steps, step_s, gravity):
    """Positions and velocities (K, steps + 1, 3) of K flights."""
    count = len(values)
    ps, vs = np.empty((count, steps + 1, 3)), np.empty((count, steps + 1, 3))
    a1, a2, a3, a4, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for row in range(count):
        ps[row, 0], vs[row, 0] = values[row, :3], values[row, 3:6]
        for k in range(steps):
            v0 = vs[row, k]
            _accelerate(v0, values[row], gravity, a1)
            v[:] = v0 + 0.5 * step_s * a1
            _accelerate(v, values[row], gravity, a2)
            v[:] = v0 + 0.5 * step_s * a2
            _accelerate(v, values[row], gravity, a3)
            v[:] = v0 + step_s * a3
            _accelerate(v, values[row], gravity, a4)
            # The position's own Runge-Kutta sum: its four velocities differ by the accelerations before them.
            ps[row, k + 1] = ps[row, k] + step_s * v0 + step_s**2 / 6 * (a1 + a2 + a3)
            vs[row, k + 1] = v0 + step_s / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return ps, vs


@njit
def _accelerate(v, values, gravity, out):
    """Gravity, drag against the velocity, and the spin's force across it, into `out`."""
    drag = values[6] * math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    out[0] = -drag * v[0] + values[8] * v[2] - values[9] * v[1]
    out[1] = -drag * v[1] + values[9] * v[0] - values[7] * v[2]
    out[2] = -drag * v[2] + values[7] * v[1] - values[8] * v[0] - gravity


def curve_of_flight(flight: FittedFlight, camera: Camera, t_us: ArrayLike, *, keyframe_sigma_px: float = 0.5) -> Curve:
    """What a flight looks like in one camera, in the form of an interpolation: nothing beyond its ends.

    Args:
        flight: fitted to several cameras.
        camera: the one in which it is drawn.
        t_us: (N,) times.
        keyframe_sigma_px: standard deviation of a label.
    """
    times = np.atleast_1d(np.asarray(t_us, np.int64))
    inside = (flight.start_us <= times) & (times <= flight.end_us)
    columns = np.full((len(times), 3), np.nan)
    if inside.any():
        columns[inside] = flight.seen_by(camera, times[inside])
    inside &= np.isfinite(columns).all(axis=1)
    columns[~inside] = np.nan
    sigma = np.where(inside, max(flight.residual_px, keyframe_sigma_px), np.nan)
    segment = np.where(inside, 0, NOT_COVERED)
    return Curve(times, columns[:, 0], columns[:, 1], columns[:, 2], sigma, segment)
