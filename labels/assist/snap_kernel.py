"""The loops of a snap, compiled: which events mark the edge of the ball, and the circle through them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.detection.refined.circle_fit import factorise, solve
from core.jit import njit

Array = NDArray[np.float64]
UNKNOWNS: Final = 5
ITERATIONS: Final = 8
"""Three bring the scale of the weights down from 3 px to `SHARPNESS_PX`, the others settle."""
SHARPNESS_PX: Final = 0.45
"""Scale of the Cauchy weight: the spread of good edge points on simulated balls."""
PRIOR: Final = 1e-4
"""Added to the normal matrix, which stays regular where the points leave an unknown open."""
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
def fit_circle(
    t_ms: Array, x: Array, y: Array, rows: NDArray[np.intp], start: Array, values: Array, normal: Array, weight: Array
) -> float:
    """Gauss-Newton on the distances from a moving circle, with Cauchy weights: the weighted spread of the distances.

    `rows` (N,) of the events it goes through; `values` (5,) x, y, their velocities and the radius, from `start` on,
    `normal` (5, 5) and `weight` (N,) of the last round are filled. nan where the points do not say which circle.

    Args:
        t_ms: (M,) times of all events relative to the instant.
        x: (M,) their columns.
        y: (M,) their rows.
        rows: (N,) the events that the circle goes through.
        start: (5,) first guess.
        values: (5,) output: centre, velocity (px, px/ms), radius.
        normal: (5, 5) output: normal matrix of the last round.
        weight: (N,) output: weights of the last round.
    """
    values[:] = start
    gradient, step, row = np.empty(UNKNOWNS), np.empty(UNKNOWNS), np.empty(UNKNOWNS)
    factor = np.empty((UNKNOWNS, UNKNOWNS))
    squares = weights = 0.0
    for iteration in range(ITERATIONS):
        # From 3 px down, halved in each round: first near the rim at all, then without outliers.
        scale = max(SHARPNESS_PX, 3.0 * 0.5**iteration)
        normal[:] = 0.0
        gradient[:] = 0.0
        squares = weights = 0.0
        for k in range(len(rows)):
            t = t_ms[rows[k]]
            dx, dy = x[rows[k]] - values[2] * t - values[0], y[rows[k]] - values[3] * t - values[1]
            distance = max(math.hypot(dx, dy), 1e-6)
            residual = distance - values[4]
            scaled = residual / scale
            weight[k] = 1.0 / (1.0 + scaled * scaled)
            row[0], row[1] = -dx / distance, -dy / distance
            row[2], row[3] = row[0] * t, row[1] * t
            row[4] = -1.0
            for i in range(UNKNOWNS):
                gradient[i] -= weight[k] * row[i] * residual
                for j in range(i + 1):
                    normal[i, j] += weight[k] * row[i] * row[j]
            squares += weight[k] * residual * residual
            weights += weight[k]
        for i in range(UNKNOWNS):
            normal[i, i] += PRIOR
            for j in range(i):
                normal[j, i] = normal[i, j]
        if not factorise(normal, factor):
            return np.nan
        solve(factor, gradient, step)
        for i in range(UNKNOWNS):
            # A longer step leaves what the linear model and the band are good for.
            values[i] += min(max(step[i], -5.0), 5.0)
    return math.sqrt(squares / max(weights, 1e-9))


def load_snap() -> None:
    """Load the compiled code, or compile it the first time, so that no click waits for it."""
    t_ms, pixel, values = np.zeros(1), np.zeros(1, np.intp), np.zeros(UNKNOWNS)
    cloud = Cloud(t_ms, t_ms, t_ms, np.ones(1, np.bool_), pixel, pixel.copy(), pixel.copy())
    edge_points(cloud, values, True, 1.0, 1.0)
    fit_circle(t_ms, t_ms, t_ms, pixel, values, values.copy(), np.empty((UNKNOWNS, UNKNOWNS)), np.empty(1))
