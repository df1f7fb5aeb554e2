"""Two cameras or more on one ball: the epipolar curve of a click, how well labels agree, which need not be of the same
instants, and where the ball is in a camera that the others know it from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera, StereoRig, TriangulationConfig, ball_circles
from core.cameras.many_views_kernel import project_with_slopes
from labels.arrays import LabelArrays
from labels.assist.curve import interpolate

Array = NDArray[np.float64]
Covariance = tuple[float, float, float]
"""Covariance xx, xy, yy of a position, px squared."""
SIGMA_PX: Final = 0.7
"""Standard deviation of a label that does not say how exact it is: a careful hand."""
CALIBRATION_PX: Final = 0.2
"""Standard deviation that a calibration adds to every position (choice)."""
JUDGED_PX: Final = 100.0
"""Positions that are farther from each other are of different things in any case."""
RADIUS_OFF_SHARE: Final = 0.25
"""A radius is clearly wrong that differs by more of the expected one (choice; 99 % of what
`refined` proposes in the sample two-throws.h5 is within 4 %)."""
RADIUS_OFF_PX: Final = 1.0
"""And by more than this: of a small ball no hand draws a quarter of the radius."""
NEAREST_M, FARTHEST_M = 0.3, 8.0
"""Depths along a ray that a ball at a table can have."""


@dataclass(frozen=True, slots=True, eq=False)
class StereoCheck:
    """N pairs of labels of the same instants; nan where one is missing or no ray exists."""

    p_world_m: Array
    """(N, 3) the point that both pictures agree on best."""
    residual_px: Array
    """(N,) distance of the labels from that point's projections, both cameras together. Errors along the epipolar line
    move the point and leave no residual: nothing can see them in two views."""
    expected_r_px: Array
    """(N, 2) radius of a ball at that point in either camera: of the circle with the area of its outline."""


def epipolar_curve(here: Camera, uv_px: ArrayLike, there: Camera, *, points: int = 192) -> Array:
    """(M, 2) pixels in camera `there` of the ray through `uv_px` in camera `here`, near to far.

    Points in front of both cameras within the sensor and a little around it; bent as the lens distorts. Empty if the
    ray cannot be seen.

    Args:
        here: the camera with the pixel.
        uv_px: (2,) the pixel.
        there: the camera in which the curve is.
        points: number of points before those out of view are left out.
    """
    ray = here.unproject(uv_px)
    if not np.isfinite(ray).all():
        return np.empty((0, 2))
    # Even in inverse depth, which is even in the picture.
    depths = 1.0 / np.linspace(1.0 / NEAREST_M, 1.0 / FARTHEST_M, points)
    curve = there.project(here.position_world_m + depths[:, None] * ray)
    width, height = there.sensor.width_px, there.sensor.height_px
    near = np.isfinite(curve).all(axis=1)
    near &= (np.abs(curve[:, 0] - width / 2) < width) & (np.abs(curve[:, 1] - height / 2) < height)
    return curve[near]


def check_stereo(first: Camera, uvs_first: ArrayLike, second: Camera, uvs_second: ArrayLike) -> StereoCheck:
    """Triangulate pairs of positions (N, 2) and compare them with the projections of the points found.

    Args:
        first: one camera.
        uvs_first: (N, 2) positions in it; nan: not seen.
        second: the other camera.
        uvs_second: (N, 2) positions of the same instants in that.
    """
    uvs = np.stack([np.atleast_2d(np.asarray(uv, np.float64)) for uv in (uvs_first, uvs_second)], axis=1)
    points = StereoRig({"first": first, "second": second}).triangulate(uvs)
    p = points.ps_world_m
    radii = [ball_circles(camera, p).r_px for camera in (first, second)]
    return StereoCheck(p, np.sqrt(2.0) * points.residuals_px, np.column_stack(radii))


@dataclass(frozen=True, slots=True, kw_only=True)
class Position:
    """Where one camera has the ball at an instant, pixels."""

    x_px: float
    y_px: float
    covariance_px2: Covariance | None = None


@dataclass(frozen=True, slots=True, eq=False)
class BallInSpace:
    """The ball as the cameras see it together at one instant."""

    p_world_m: Array
    """(3,)."""
    covariance_m2: Array
    """(3, 3), from that of the positions."""
    residual_px: float
    """Root mean square distance of the positions from its projections, of the cameras that it is made of."""
    off_px: Mapping[str, float]
    """Distance of each camera's position from its projection; also of the cameras that were left out."""
    cameras: tuple[str, ...]
    """Those that it is made of: of three or more, not those that have something elsewhere."""


@dataclass(frozen=True, slots=True)
class Reprojection:
    """A ball in space as it is in one camera's picture."""

    x_px: float
    y_px: float
    r_px: float
    covariance_px2: Covariance


def ball_in_space(cameras: Mapping[str, Camera], positions: Mapping[str, Position]) -> BallInSpace | None:
    """The ball at the positions that two or more of the cameras have of it; None where no two rays meet."""
    known = {name: cameras[name] for name in positions if name in cameras}
    if len(known) < 2:
        return None
    rig = StereoRig(known, TriangulationConfig(sigma_px=SIGMA_PX, max_residual_px=JUDGED_PX))
    uvs = np.array([(positions[name].x_px, positions[name].y_px) for name in known])
    point = rig.triangulate_one(uvs, np.array([_matrix(positions[name].covariance_px2) for name in known]))
    if point is None:
        return None
    seen = [camera.project(point.p_world_m)[0] for camera in known.values()]
    off_px = {name: float(np.hypot(*(uv - at))) for name, uv, at in zip(known, uvs, seen, strict=True)}
    used = point.cameras or tuple(known)
    return BallInSpace(point.p_world_m, point.covariance_m2, point.residual_px, off_px, used)


def reproject(ball: BallInSpace, camera: Camera) -> Reprojection | None:
    """The ball in a camera's picture, with the covariance of its centre there; None outside the picture."""
    circle = ball_circles(camera, ball.p_world_m)
    x, y, r = float(circle.u_px[0]), float(circle.v_px[0]), float(circle.r_px[0])
    inside = -0.5 <= x < camera.sensor.width_px - 0.5 and -0.5 <= y < camera.sensor.height_px - 0.5
    if not (np.isfinite(r) and inside):
        return None
    slope, R = np.full((2, 3), np.nan), np.ascontiguousarray(camera.T_world_camera[:3, :3])
    project_with_slopes(ball.p_world_m, camera.position_world_m, R, camera.lens_row(), slope)
    spread = slope @ ball.covariance_m2 @ slope.T + CALIBRATION_PX**2 * np.eye(2)
    if not np.isfinite(spread).all():
        return None
    return Reprojection(x, y, r, (float(spread[0, 0]), float(spread[0, 1]), float(spread[1, 1])))


def median_over_cameras(values_px: Sequence[Array]) -> Array | None:
    """(N,) median over the other cameras of what each says of N labels; None without one, nan where none is known.

    A label that one of several other cameras contradicts stands, one that most of them contradict does not.
    """
    if not values_px:
        return None
    stack = np.stack(values_px)
    middle = np.full(stack.shape[1], np.nan)
    known = np.isfinite(stack).any(axis=0)
    middle[known] = np.nanmedian(stack[:, known], axis=0)
    return middle


def radius_is_off(r_px: ArrayLike, expected_r_px: ArrayLike) -> NDArray[np.bool_]:
    """Where circles are clearly not of a ball where the cameras have it; never where either radius, px, is nan."""
    expected = np.asarray(expected_r_px, np.float64)
    off_px = np.abs(np.asarray(r_px, np.float64) - expected)
    return off_px > np.maximum(RADIUS_OFF_SHARE * expected, RADIUS_OFF_PX)


def _matrix(covariance_px2: Covariance | None) -> Array:
    """(2, 2) covariance of a position and of the calibration."""
    xx, xy, yy = covariance_px2 or (SIGMA_PX**2, 0.0, SIGMA_PX**2)
    return np.array([[xx, xy], [xy, yy]]) + CALIBRATION_PX**2 * np.eye(2)


def check_labels(here: Camera, labels: LabelArrays, there: Camera, others: LabelArrays) -> StereoCheck:
    """How well each label agrees with the other camera's label of its instant, or with the curve through them.

    nan where either camera sees no ball, and where the other camera's labels do not reach.

    Args:
        here: calibration of the camera of `labels`.
        labels: those that are checked.
        there: calibration of the other camera.
        others: its labels.
    """
    uv_here = np.column_stack([labels.x_px, labels.y_px])
    uv_here[~labels.seen] = np.nan
    return check_stereo(here, uv_here, there, labelled_positions_at(others, labels.t_us))


def labelled_positions_at(labels: LabelArrays, t_us: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N, 2) where labels say the ball is at other times: a label itself where there is one, else the curve."""
    curve = interpolate(labels, t_us)
    places = np.column_stack([curve.x_px, curve.y_px])
    seen = labels.rows(labels.seen)
    _, own, at = np.intersect1d(seen.t_us, t_us, return_indices=True)
    places[at] = np.column_stack([seen.x_px, seen.y_px])[own]
    return places
