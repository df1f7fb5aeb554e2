"""Fit of one ball to recent events, from a track's prediction or from a position alone."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.refined.circle_fit import UNKNOWNS, EdgePoints, Fit, factorise, fit_circle, solve
from core.detection.refined.history import Recent
from core.detection.refined.patch import (
    HALF,
    MAX_POINTS,
    LookBack,
    MovingCircle,
    Patch,
    blank_patch,
    clear_patch,
    edge_points,
    fill_patch,
)
from core.jit import njit

SECTORS: Final = 16
FEWEST_POINTS: Final = 6
"""Fewest edge points that are fitted: as many as there are unknowns."""
FEWEST_EVENTS: Final = 12
"""Fewest events in a box for a start estimate."""
MIN_SPREAD_MS2: Final = 1e-4
"""Smallest spread in time of these events, ms^2."""
MIN_RECENT_MS: Final = 1.5
"""Age of a slow sensor's newest events."""
SIGMA_PX: Final = 0.4
"""Standard deviation of one edge point, px."""
JITTER_MS: Final = 0.04
"""Time jitter of an event, ms: a fast edge spreads more."""
ITERATIONS: Final = 8


class Work(NamedTuple):
    """Working arrays of a fit."""

    patch: Patch
    points: EdgePoints
    fit: Fit
    quality: NDArray[np.float64]
    """(10,) see `Quality`."""
    covariance: NDArray[np.float64]
    """(6, 6) covariance of the estimate for independent errors of the points."""
    counts: NDArray[np.int64]
    """(4,) of the last fit, for its trace: edge points, touched pixels of the patch, address x and y of its origin."""


class Quality(NamedTuple):
    """Quality of a fit."""

    residual_px: float
    """Root mean square distance of the edge points from the circle, for a slow ball: a fast one may have more."""
    points: float
    """Edge points with a weight above one half."""
    coverage_lead: float
    """Share of the leading half's sectors with such points."""
    coverage_trail: float
    inside: float
    """Events well inside the disc per event of a pixel with such a point."""
    stray: float
    """Share of the edge points with less weight."""
    fill: float
    """Such points, as a share of the pixels that both edges swept."""
    contrast: float
    """Events of a pixel with such a point."""
    brighter: float
    """From -1 to 1: whether the leading edge makes pixels darker or brighter."""
    fresh: float
    """Share of the leading edge's such points that came in the last third of the history, or the last 1.5 ms if that is
    more; steady motion brings a third, what has vanished none."""

    @property
    def coverage(self) -> float:
        """Coverage of the edge with fewer events, 0 to 1."""
        return min(self.coverage_lead, self.coverage_trail)


class Reach(NamedTuple):
    """Time and distance limits of a fit."""

    motion_px: float
    history_min_ms: float
    history_max_ms: float
    tail: bool = False
    """See `LookBack.tail`."""


def blank_work() -> Work:
    """Working arrays for fits."""
    columns = np.zeros((6, MAX_POINTS))
    estimate, prior, information = np.zeros((3, UNKNOWNS))
    fit = Fit(estimate, prior, information, np.zeros(2), np.zeros((UNKNOWNS, UNKNOWNS)))
    quality, covariance = np.zeros(len(Quality._fields)), np.zeros((UNKNOWNS, UNKNOWNS))
    return Work(blank_patch(), EdgePoints(*columns), fit, quality, covariance, np.zeros(4, np.int64))


@njit
def span_for(end_us: int, speed: float, reach: Reach, polarity: int = 0) -> LookBack:
    """Limits of the events used for a ball of this speed in px/ms.

    Args:
        end_us: end of the window.
        speed: of the ball, px/ms.
        reach: motion and times of the history.
        polarity: see `LookBack`.
    """
    speed = max(speed, 0.05)
    history = min(max(reach.motion_px / speed, reach.history_min_ms), reach.history_max_ms)
    # A pixel's newest event is its last one only when the edge has left it: 0.8 px later.
    guard = min(max(0.8 / speed, 0.3), 4.0, 0.4 * history)
    # Read back farther than the history, or the first event read would not be the pixel's first one.
    before = min(max(1.5 / speed, 1.0), 5.0)
    return LookBack(end_us, history + before, history, guard, reach.tail, polarity)


@njit
def fit_ball(
    recent: Recent, work: Work, end_us: int, reach: Reach, band_px: float, rounds: int, polarity: int = 0
) -> bool:
    """Fit from `work.fit.estimate` with its prior; estimate, quality and covariance are then in `work`.

    Each round gathers the edge points anew, within a band that ends at `band_px`. See `LookBack` for `polarity`.

    Args:
        recent: events of the history.
        work: arrays that are worked in; `work.fit` has estimate, prior and information.
        end_us: end of the window, at which the estimate holds.
        reach: motion and times of the history.
        band_px: half width of the last round's band round the rim.
        rounds: how often edge points are gathered.
        polarity: see `LookBack`.
    """
    estimate, bend = work.fit.estimate, work.fit.bend
    speed = math.hypot(estimate[2], estimate[3])
    span = span_for(end_us, speed, reach, polarity)
    asked = math.ceil(estimate[4] + speed * span.gather_ms + band_px + 3.0)
    count, x0, y0 = fill_patch(recent, work.patch, estimate[0], estimate[1], min(HALF, asked), span)
    fine = False
    work.counts[1], work.counts[2], work.counts[3] = count, x0, y0
    # A jitter in time is one in place at this speed: the two spreads add in squares.
    blur = math.sqrt(1.0 + (speed * JITTER_MS / SIGMA_PX) ** 2)
    for round_number in range(rounds):
        # Each round halves the band: the first one has to find the rim from a rough estimate.
        wider = 2.0 ** (rounds - 1 - round_number)
        ball = MovingCircle(
            estimate[0], estimate[1], estimate[2], estimate[3], estimate[4], estimate[5], bend[0], bend[1]
        )
        found, inside = edge_points(work.patch, count, (x0, y0), ball, band_px * wider, span, work.points)
        work.counts[0] = found
        fine = found >= FEWEST_POINTS
        if not fine:
            break
        residual = fit_circle(work.points, found, work.fit, blur * SIGMA_PX, 0.5 * blur * wider, ITERATIONS)
        fine = residual < 1e9 and 1.0 < estimate[4] < HALF
        if not fine:
            break
        if round_number == rounds - 1:
            _judge(work, found, inside, residual / blur, span)
    clear_patch(work.patch, count)
    return fine


@njit
def _judge(work, found, inside, residual, span):
    estimate, points, quality = work.fit.estimate, work.points, work.quality
    sectors = np.zeros(SECTORS)
    good, events, lead_sum, leads, fresh = 0, 0.0, 0.0, 0, 0
    recent_ms = max(span.history_ms / 3.0, MIN_RECENT_MS)
    motion_px = math.hypot(estimate[2], estimate[3]) * (span.history_ms - 0.5 * span.guard_ms)
    heading = math.atan2(estimate[3], estimate[2])
    for k in range(found):
        if points.weight[k] < 0.5:
            continue
        good += 1
        events += points.events[k]
        lead_sum += points.lead[k]
        leads += points.lead[k] != 0.0
        fresh += points.lead[k] != 0.0 and points.ms[k] > -recent_ms
        ms = points.ms[k] + (estimate[5] if points.lead[k] != 0.0 else -estimate[5])
        du = points.u[k] - estimate[0] - (estimate[2] + 0.5 * work.fit.bend[0] * ms) * ms
        dv = points.v[k] - estimate[1] - (estimate[3] + 0.5 * work.fit.bend[1] * ms) * ms
        # Sectors begin a quarter turn before the heading: the first half of them is the leading half.
        turn = (math.atan2(dv, du) - heading + 0.5 * math.pi) / (2.0 * math.pi)
        sectors[math.floor((turn - math.floor(turn)) * SECTORS) % SECTORS] += 1.0
    lead, trail = 0, 0
    half = SECTORS // 2
    for k in range(half):
        lead += sectors[k] > 0.0
        trail += sectors[half + k] > 0.0
    quality[0], quality[1] = residual, good
    quality[2], quality[3] = lead / half, trail / half
    quality[4] = inside / max(1.0, events)
    quality[5] = 1.0 - good / found
    # Each of the two edges sweeps a strip of 2 r times the motion.
    quality[6] = good / (4.0 * estimate[4] * motion_px)
    quality[7] = events / max(1, good)
    quality[8] = lead_sum / max(1, leads)
    quality[9] = fresh / max(1, leads)
    factor = np.empty((UNKNOWNS, UNKNOWNS))
    unit = np.empty(UNKNOWNS)
    if factorise(work.fit.normal, factor):
        for i in range(UNKNOWNS):
            unit[:] = 0.0
            unit[i] = 1.0
            solve(factor, unit, work.covariance[i])


@njit
def start_from_place(
    recent: Recent, box: NDArray[np.float64], end_us: int, span_us: int, estimate: NDArray[np.float64]
) -> bool:
    """First estimate from the events in a box (u, v, width, height): from their drift and their spread.

    Args:
        recent: events of the history.
        box: (4,) u, v of the centre, width and height, px.
        end_us: end of the window.
        span_us: age of the oldest events used.
        estimate: (6,) output, as `circle_fit.UNKNOWNS`; the stretch is left as it is.
    """
    u, v = box[0], box[1]
    half_u, half_v = 0.5 * box[2] + 2.0, 0.5 * box[3] + 2.0
    begin = np.searchsorted(recent.t_us, end_us - span_us)
    count, sum_t, sum_u, sum_v, sum_tt, sum_tu, sum_tv, sum_rr = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(begin, len(recent.t_us)):
        du, dv = recent.x_px[k] - u, recent.y_px[k] - v
        if abs(du) > half_u or abs(dv) > half_v:
            continue
        ms = 0.001 * (recent.t_us[k] - end_us)
        count += 1
        sum_t, sum_u, sum_v = sum_t + ms, sum_u + du, sum_v + dv
        sum_tt, sum_tu, sum_tv = sum_tt + ms * ms, sum_tu + ms * du, sum_tv + ms * dv
        sum_rr += du * du + dv * dv
    if count < FEWEST_EVENTS:
        return False
    mean_t, mean_u, mean_v = sum_t / count, sum_u / count, sum_v / count
    spread = sum_tt / count - mean_t * mean_t
    if spread < MIN_SPREAD_MS2:
        return False
    # Least squares u = u0 + vu t; what is left about that line is r^2, as all events are on the rim.
    vu = (sum_tu / count - mean_t * mean_u) / spread
    vv = (sum_tv / count - mean_t * mean_v) / spread
    about_the_line = sum_rr / count - mean_u * mean_u - mean_v * mean_v - (vu * vu + vv * vv) * spread
    estimate[0], estimate[1] = u + mean_u - vu * mean_t, v + mean_v - vv * mean_t
    estimate[2], estimate[3] = vu, vv
    estimate[4] = math.sqrt(max(0.0, about_the_line))
    return True
