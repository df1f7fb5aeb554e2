"""Snap: the circle that fits the events near a click, at one instant, compensated for motion, with its covariance.

Each pixel tells when the ball's edge passes it: the first event of the polarity that leads, the last of the one that
trails. Moved along the ball's motion to the wanted instant, these lie on two arcs of one circle. Centre, velocity and
radius (five unknowns) are fitted to both arcs at once: each arc alone is biased along the motion, and together the
biases cancel in the centre and stay in the radius, from which they are taken by the width of the edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.events import Events
from labels.assist.snap_kernel import Cloud, edge_points, fit_edges

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapConfig:
    """What a snap looks at and what it calls a ball."""

    search_px: float = setting(8.0, 1.0, 40.0)
    """How far the ball's centre may be from the click."""
    radius_min_px: float = setting(1.5, 0.5, 20.0)
    """Smallest ball."""
    radius_max_px: float = setting(24.0, 2.0, 100.0)
    """Largest ball."""
    reach_us: int = setting(16_000, 500, 100_000)
    """Events at most so long before and after the instant are used."""
    motion_px: float = setting(2.0, 0.5, 10.0)
    """Events from so much motion before and after the instant are used: enough for whole arcs, little enough that
    velocity is constant."""
    delay_us: float = setting(240.0, 0.0, 2000.0)
    """How late events are: the lag of the photoreceptor, mean of the first event of a leading edge and the last of a
    trailing one. Measured: 240 us for a simulated photoreceptor of 200 us. The centre moves by so much motion."""
    delay_sigma_us: float = setting(40.0, 0.0, 1000.0)
    """How well that is known; it is in the covariance along the motion."""
    edge_share: float = setting(0.6, 0.0, 1.0)
    """Share of an edge's width, from a pixel's first event to its last, that lies outside the ball's outline: the arcs
    are of first leading and last trailing events, so their circle is too large by as much. Fitted on 297 simulated
    balls of six scenes and sensors. On other balls the median radius is right within 0.5 % (bright ball, two sensors),
    1.5 % (low contrast) and 3.5 % (dark ball); without, bright balls are 12 % too large."""
    sharpness_min: float = setting(0.5, 0.0, 1.0)
    """Least mean weight of the edge points: noise, spread evenly over the band in which they are sought, has 0.3."""
    points_per_radius: float = setting(5.0, 1.0, 20.0)
    """Least number of edge points for each pixel of radius: simulated balls have 9 to 20, chance alignments fewer."""
    residual_max_px: float = setting(1.2, 0.1, 5.0)
    """Larger than this and it is no circle."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class Snap:
    """A circle in the picture at `t_us`."""

    t_us: int
    x_px: float
    y_px: float
    r_px: float
    """Radius of the circle with the area of the ball's outline, as in `core.cameras.outline`."""
    vx_px_per_ms: float
    vy_px_per_ms: float
    covariance_px2: tuple[float, float, float]
    """(xx, xy, yy) of the centre."""
    residual_px: float
    """Robust standard deviation of the arcs' points from the circle."""
    points: int
    """Pixels that the fit rests on."""
    on_leads: bool


def snap(
    events: Events,
    t_us: int,
    x_px: float,
    y_px: float,
    *,
    r_px: float | None = None,
    v_px_per_ms: tuple[float, float] | None = None,
    config: SnapConfig | None = None,
) -> Snap | None:
    """The ball near (x_px, y_px) at `t_us`, or None where no circle fits.

    `events` should reach from `reach_us` before to `reach_us` after the instant; more does no harm. Radius and velocity
    are guesses: a velocity, such as the one found a moment before, makes it several times faster.

    Args:
        events: around the instant.
        t_us: the instant.
        x_px: guess of the centre's column.
        y_px: guess of its row.
        r_px: guess of the radius.
        v_px_per_ms: guess of the velocity.
        config: reach, radii and the sensor's delay.
    """
    config = config or SnapConfig()
    late_us = t_us + config.delay_us
    near = events.between(int(late_us) - config.reach_us, int(late_us) + config.reach_us)
    reach_px = config.search_px + 1.3 * (r_px or config.radius_max_px)
    x, y = near.x_px.astype(np.float64) - x_px, near.y_px.astype(np.float64) - y_px
    close = np.maximum(np.abs(x), np.abs(y)) < 2 * reach_px
    t_ms = np.asarray((near.t_us[close] - late_us) * 1e-3, np.float64)
    if not len(t_ms):
        return None
    column, row = (place[close].astype(np.intp) for place in (near.x_px, near.y_px))
    column, row = column - column.min(), row - row.min()
    width = column.max() + 1
    spaces = (np.empty((row.max() + 1) * width, np.intp) for _ in range(2))
    cloud = Cloud(t_ms, x[close], y[close], near.on[close], row * width + column, *spaces)
    starts = list(START_HALF_MS)
    if v_px_per_ms is not None:
        moving_ms = config.motion_px / max(float(np.hypot(*v_px_per_ms)), 1e-3)
        starts.insert(0, min(max(moving_ms, START_HALF_MS[0]), START_HALF_MS[-1]))
    best: _Fit | None = None
    for half_ms in starts:
        fit = _fit_from(cloud, half_ms, reach_px, r_px, config)
        if fit is None or not _is_ball(fit, config):
            continue
        if best is not None and np.abs(fit.values - best.values).max() < AGREE_PX:
            break  # two starts that lead to the same circle: the others would too
        best = fit if best is None or fit.score > best.score else best
    return None if best is None else _snap_of(best, _edge_width_px(cloud, best, config), t_us, x_px, y_px, config)


START_HALF_MS = (0.25, 0.7, 2.0, 6.0, 14.0)
"""Half windows to start from: one of them holds about a pixel or two of motion, from 0.1 to 15 px/ms."""
AGREE_PX = 0.1
FLOOR_PX = 0.02
"""What the pixels themselves leave, however many events there are."""
EDGE_REACH, EDGE_MS = 2.5, 0.6
"""An edge's events last so many half windows at most, and while it moves for so long."""
ROUNDS = 5


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    values: Array
    """cx, cy, vx, vy, r"""
    covariance: Array
    """(5, 5)"""
    residual_px: float
    points: int
    sharpness: float
    """Mean weight of the points near the circle: 1 if all lie on it, 0.3 if they are spread evenly about it."""
    balance: float
    """0 if all points are on one arc, 1 if both have as many."""
    on_leads: bool

    @property
    def score(self) -> float:
        """Many points on both arcs, close to the circle."""
        return self.balance * float(np.sqrt(self.points)) / (0.2 + self.residual_px)


def _fit_from(cloud: Cloud, half_ms: float, reach_px: float, r_px: float | None, config: SnapConfig) -> _Fit | None:
    """Alternate between choosing edge points with the circle known so far, and fitting the circle to them."""
    start = _first_guess(cloud, half_ms, reach_px, r_px)
    if start is None:
        return None
    values, on_leads = start
    fit, band = None, 6.0
    for _ in range(ROUNDS):
        speed = float(np.hypot(values[2], values[3]))
        half_ms = float(np.clip(config.motion_px / max(speed, 1e-3), 0.08, config.reach_us * 1e-3))
        rows, leading = edge_points(cloud, values, on_leads, half_ms, band)
        if leading < 4 or len(rows) - leading < 4:
            return None
        fit = _fit_circle(cloud, rows, leading, values, on_leads)
        if fit is None or not _is_sane(fit.values, reach_px):
            return None
        values, band = fit.values, max(2.0, 0.6 * band)
    return fit


def _first_guess(cloud: Cloud, half_ms: float, reach_px: float, r_px: float | None) -> tuple[Array, bool] | None:
    """Circle and velocity from the moments of both polarities: they lie on opposite sides of the ball."""
    near = slice(np.searchsorted(cloud.t_ms, -half_ms, "right"), np.searchsorted(cloud.t_ms, half_ms))
    t_ms, points = cloud.t_ms[near], np.column_stack([cloud.x[near], cloud.y[near]])
    rows = np.hypot(points[:, 0], points[:, 1]) < reach_px
    on, off = rows & cloud.on[near], rows & ~cloud.on[near]
    if on.sum() < 5 or off.sum() < 5:
        return None
    on_middle, off_middle = np.median(points[on], axis=0), np.median(points[off], axis=0)
    dipole = on_middle - off_middle
    length = float(np.hypot(*dipole))
    if length < 1.0:
        return None
    along = dipole / length
    slopes = [_slope(t_ms[side], points[side] @ along) for side in (on, off)]
    speed = float(np.mean(slopes))
    centre = 0.5 * (on_middle + off_middle)
    radius = r_px or max(2.0, 0.55 * length)  # arcs of half a circle: their medians are about 1.8 r apart
    return np.array([*centre, *(speed * along), radius]), speed > 0


def _slope(t: Array, s: Array) -> float:
    t = t - t.mean()
    return float(t @ s / max(float(t @ t), 1e-9))


def _fit_circle(cloud: Cloud, rows: NDArray[np.intp], leading: int, start: Array, on_leads: bool) -> _Fit | None:
    values, covariance, weight = start.copy(), np.empty((len(start), len(start))), np.empty(len(rows))
    spread = fit_edges(cloud, rows, values, covariance, weight)
    if not np.isfinite(spread):
        return None
    sides = min(weight[:leading].sum(), weight[leading:].sum()) / max(0.5 * weight.sum(), 1e-9)
    return _Fit(
        values, covariance * max(spread, 0.1) ** 2, spread, len(rows), float(weight.mean()), float(sides), on_leads
    )


def _is_sane(values: Array, reach_px: float) -> bool:
    return bool(np.isfinite(values).all() and np.hypot(values[0], values[1]) < reach_px and 0.5 < values[4] < 200)


def _is_ball(fit: _Fit, config: SnapConfig) -> bool:
    close = np.hypot(fit.values[0], fit.values[1]) <= config.search_px
    size = config.radius_min_px <= fit.values[4] <= config.radius_max_px
    sharp = fit.residual_px <= config.residual_max_px and fit.sharpness >= config.sharpness_min
    full = fit.points >= config.points_per_radius * fit.values[4]
    return bool(close and size and sharp and full and fit.balance > 0.2)


def _edge_width_px(cloud: Cloud, fit: _Fit, config: SnapConfig) -> float:
    """How far an edge moves from a pixel's first event to its last, along the radius: the mean of both edges."""
    cx, cy, vx, vy, r = fit.values
    speed = float(np.hypot(vx, vy))
    half_ms = float(np.clip(config.motion_px / max(speed, 1e-3), 0.08, config.reach_us * 1e-3))
    dx, dy = cloud.x - vx * cloud.t_ms - cx, cloud.y - vy * cloud.t_ms - cy
    off = np.hypot(dx, dy) - r
    near = (np.abs(cloud.t_ms) < EDGE_REACH * half_ms) & (np.abs(off) < max(2.0, 1.0 + EDGE_MS * speed))
    ahead = dx * vx + dy * vy > 0
    pixel = cloud.pixel
    widths = []
    for leading in (True, False):
        rows = np.flatnonzero(near & ((cloud.on == fit.on_leads) == leading) & (ahead == leading))
        first = rows[np.unique(pixel[rows], return_index=True)[1]]
        last = rows[::-1][np.unique(pixel[rows[::-1]], return_index=True)[1]]
        marks = np.abs(cloud.t_ms[first if leading else last]) < half_ms
        if not marks.any():
            return 0.0
        widths.append(abs(float(np.mean((off[first] - off[last])[marks]))))
    return float(np.mean(widths))


def _snap_of(fit: _Fit, width_px: float, t_us: int, x_px: float, y_px: float, config: SnapConfig) -> Snap:
    cx, cy, vx, vy, r = fit.values.tolist()
    late_ms = config.delay_sigma_us * 1e-3
    cov = fit.covariance
    return Snap(
        t_us=t_us,
        x_px=x_px + cx,
        y_px=y_px + cy,
        r_px=max(r - config.edge_share * width_px, 0.5 * r),
        vx_px_per_ms=vx,
        vy_px_per_ms=vy,
        covariance_px2=(
            float(cov[0, 0]) + (vx * late_ms) ** 2 + FLOOR_PX**2,
            float(cov[0, 1]) + vx * vy * late_ms**2,
            float(cov[1, 1]) + (vy * late_ms) ** 2 + FLOOR_PX**2,
        ),
        residual_px=fit.residual_px,
        points=fit.points,
        on_leads=fit.on_leads,
    )
