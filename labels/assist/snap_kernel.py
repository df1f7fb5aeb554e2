"""The loops of a snap, compiled: which events mark the edge of the ball, and the circle through them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.refined.circle_fit import UNKNOWNS, EdgePoints, Fit, factorise, fit_circle, solve
from core.jit import njit

Array = NDArray[np.float64]
SCALES_PX: Final = (3.0, 1.5, 0.75, 0.45)
"""Scales of the Cauchy weight, one after the other: a first guess is pixels off, and a narrow weight would leave out
the arc that it misses. The last is the spread of good edge points on simulated balls."""
ITERATIONS: Final = 5
"""Steps at most with the last scale; each other scale has one."""
PRIOR: Final = 1e-4
"""Information that keeps the fit regular where the points leave something open."""
GUARD: Final = 1.5
"""Half windows before and after the window in which a pixel must have been quiet."""


class Cloud(NamedTuple):
    """N events near the click in order of time: milliseconds from the instant, pixels from the click."""

    t_ms: Array
    x: Array
    y: Array
    on: NDArray[np.bool_]
    pixel: NDArray[np.intp]
    """Which of the P pixels of the rectangle that holds all events, row by row from 0."""
    first: NDArray[np.intp]
    last: NDArray[np.intp]
    """Workspace, one for each of these P pixels."""


@njit
def edge_points(
    cloud: Cloud, values: Array, on_leads: bool, half_ms: float, band_px: float
) -> tuple[NDArray[np.intp], int]:
    """Rows of the events that mark the edge, near the circle `values`, and how many of them, at the front, lead.

    Per pixel the first leading and the last trailing one. A pixel's first event must be its first: one that had another
    shortly before the window is left out; so behind it.

    Args:
        cloud: events with times (ms) and places (px) relative to the click.
        values: (5,) the circle: centre, velocity (px, px/ms) and radius.
        on_leads: whether ON events are at the front.
        half_ms: half the length of time that is looked at.
        band_px: how far from the circle an event may be.
    """
    t_ms, x, y, on, pixel, first, last = cloud
    cx, cy, vx, vy, r = values
    first[:] = -1
    last[:] = -1
    # Read farther than what counts: an earlier event shows that a pixel's first in the window is not its first.
    reach_ms = half_ms + GUARD * half_ms
    for i in range(np.searchsorted(t_ms, -reach_ms), len(t_ms)):
        t = t_ms[i]
        if t <= -reach_ms:
            continue
        if t >= reach_ms:
            break
        dx, dy = x[i] - vx * t - cx, y[i] - vy * t - cy
        if abs(math.hypot(dx, dy) - r) >= band_px:
            continue
        ahead = dx * vx + dy * vy > 0
        leads = on[i] == on_leads
        if leads and ahead:
            if first[pixel[i]] < 0:
                first[pixel[i]] = i
        elif not leads and not ahead:
            last[pixel[i]] = i
    rows = np.empty(2 * len(first), np.intp)
    leading = _within(first, t_ms, half_ms, rows, 0)
    count = _within(last, t_ms, half_ms, rows, leading)
    return rows[:count], leading


@njit
def _within(found: NDArray[np.intp], t_ms: Array, half_ms: float, rows: NDArray[np.intp], count: int) -> int:
    for i in found:
        if i >= 0 and abs(t_ms[i]) < half_ms:
            rows[count] = i
            count += 1
    return count


@njit
def fit_edges(cloud: Cloud, rows: NDArray[np.intp], values: Array, covariance: Array, weight: Array) -> float:
    """The moving circle through the edge points: the spread of their distances from it, px, infinite if there is none.

    The fit is the one of the detector `refined`, without its stretch: the delay of the sensor is a setting here.

    Args:
        cloud: events with times (ms) and places (px) relative to the click.
        rows: (N,) the events that the circle goes through.
        values: (5,) centre, velocity (px, px/ms) and radius: first guess and result.
        covariance: (5, 5) output: of the values, for points with an error of 1 px.
        weight: (N,) output: weights of the last round.
    """
    u, v, ms = cloud.x[rows], cloud.y[rows], cloud.t_ms[rows]
    points = EdgePoints(u, v, ms, np.ones(len(rows)), np.ones(len(rows)), weight)
    estimate, information = np.zeros(UNKNOWNS), np.full(UNKNOWNS, PRIOR)
    estimate[:-1] = values
    information[-1] = 1e12
    fit = Fit(estimate, estimate.copy(), information, np.zeros(2), np.empty((UNKNOWNS, UNKNOWNS)))
    spread = np.inf
    for number, scale_px in enumerate(SCALES_PX):
        steps = ITERATIONS if number == len(SCALES_PX) - 1 else 1
        spread = fit_circle(points, len(rows), fit, 1.0, scale_px, steps)
        if not spread < np.inf:
            return spread
    values[:] = estimate[:-1]
    factor, unit, column = np.empty((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS), np.empty(UNKNOWNS)
    factorise(fit.normal, factor)
    for i in range(UNKNOWNS - 1):
        unit[:] = 0.0
        unit[i] = 1.0
        solve(factor, unit, column)
        covariance[i] = column[:-1]
    return spread


def load_snap() -> None:
    """Load the compiled code, or compile it the first time, so that no click waits for it."""
    t_ms, pixel, values = np.zeros(1), np.zeros(1, np.intp), np.zeros(UNKNOWNS - 1)
    cloud = Cloud(t_ms, t_ms, t_ms, np.ones(1, np.bool_), pixel, pixel.copy(), pixel.copy())
    edge_points(cloud, values, True, 1.0, 1.0)
    fit_edges(cloud, pixel, values, np.empty((UNKNOWNS - 1, UNKNOWNS - 1)), np.empty(1))
