"""A circle on a parabola, fitted to edge points: robust Gauss-Newton with a prior.

Each edge point is a pixel and the time at which the ball's edge passed it. On the leading edge that is the pixel's
first event, on the trailing edge its last: both mark the same small coverage of the pixel by the ball, whatever the
polarity, so that a bias of the radius does not shift the centre.

The last event comes late, by several time constants of a slow photoreceptor (0.4 to 2 ms on drawn sensors), the first
one hardly: seen so, the ball is longer by its motion in that time. Half of it, the `stretch`, is an unknown of the fit.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.jit import njit

UNKNOWNS: Final = 6
"""Centre u and v [px] at the end of the window, velocity u and v then [px/ms], radius [px], stretch [ms]: the order
everywhere here. The leading edge is where the ball will be after the stretch, the trailing where it was before it."""


class EdgePoints(NamedTuple):
    """Arrays of edge points; the first `count` are in use."""

    u: NDArray[np.float64]
    v: NDArray[np.float64]
    ms: NDArray[np.float64]
    """Time relative to the end of the window, negative."""
    events: NDArray[np.float64]
    """(N,) events of the pixel in the interval used: more at an edge of higher contrast."""
    lead: NDArray[np.float64]
    """1: the leading edge made the pixel brighter, -1: darker, 0: trailing edge."""
    weight: NDArray[np.float64]
    """(N,) weights of the last iteration."""


class Fit(NamedTuple):
    """Working arrays of a fit: the estimate and its prior."""

    estimate: NDArray[np.float64]
    """(6,) estimate, start and result of the iteration."""
    prior: NDArray[np.float64]
    """(6,) expected values."""
    information: NDArray[np.float64]
    """(6,) 1/sigma^2 of each; 0: nothing is known."""
    bend: NDArray[np.float64]
    """(2,) known acceleration u and v [px/ms^2]."""
    normal: NDArray[np.float64]
    """(6, 6) normal matrix of the last iteration, with the prior."""


@njit
def fit_circle(points: EdgePoints, count: int, fit: Fit, sigma_px: float, scale_px: float, iterations: int) -> float:
    """Fit; the weighted root mean square residual, infinite where the points determine nothing.

    Args:
        points: edge points; their weights are written.
        count: how many of them.
        fit: estimate (changed in place), prior (6,), its information (6,), and the path's bend, px/ms^2.
        sigma_px: spread of one edge point.
        scale_px: distance at which a point has half its weight (Cauchy).
        iterations: most steps of Gauss-Newton.
    """
    estimate, bend, normal = fit.estimate, fit.bend, fit.normal
    gradient = np.empty(UNKNOWNS)
    step = np.empty(UNKNOWNS)
    factor = np.empty((UNKNOWNS, UNKNOWNS))
    row = np.empty(UNKNOWNS)
    per_point = 1.0 / (sigma_px * sigma_px)
    squares, weights = 0.0, 0.0
    for _ in range(iterations):
        for i in range(UNKNOWNS):
            gradient[i] = fit.information[i] * (fit.prior[i] - estimate[i])
            for j in range(UNKNOWNS):
                normal[i, j] = 0.0
            normal[i, i] = fit.information[i]
        squares, weights = 0.0, 0.0
        for k in range(count):
            ahead = 1.0 if points.lead[k] != 0.0 else -1.0
            ms = points.ms[k] + ahead * estimate[5]
            du = points.u[k] - estimate[0] - (estimate[2] + 0.5 * bend[0] * ms) * ms
            dv = points.v[k] - estimate[1] - (estimate[3] + 0.5 * bend[1] * ms) * ms
            distance = math.sqrt(du * du + dv * dv)
            if distance < 1e-6:
                points.weight[k] = 0.0
                continue
            error = distance - estimate[4]
            weight = 1.0 / (1.0 + (error / scale_px) ** 2)
            points.weight[k] = weight
            squares += weight * error * error
            weights += weight
            # Minus the slope of the error, so that the step is added.
            row[0], row[1] = du / distance, dv / distance
            row[2], row[3], row[4] = row[0] * ms, row[1] * ms, 1.0
            row[5] = ahead * (row[0] * (estimate[2] + bend[0] * ms) + row[1] * (estimate[3] + bend[1] * ms))
            scaled = weight * per_point
            for i in range(UNKNOWNS):
                gradient[i] += scaled * row[i] * error
                for j in range(i + 1):
                    normal[i, j] += scaled * row[i] * row[j]
        for i in range(UNKNOWNS):
            for j in range(i):
                normal[j, i] = normal[i, j]
        if not factorise(normal, factor):
            return np.inf
        solve(factor, gradient, step)
        largest = 0.0
        for i in range(UNKNOWNS):
            estimate[i] += step[i]
            largest = max(largest, abs(step[i]))
        # A hundredth of an edge point's spread: going on changes nothing that is reported.
        if largest < 5e-3:
            break
    return math.sqrt(squares / weights) if weights > 0.0 else np.inf


@njit
def factorise(matrix: NDArray[np.float64], factor: NDArray[np.float64]) -> bool:
    """Cholesky's lower factor; false where the matrix is not positive definite."""
    size = len(matrix)
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if total <= 1e-12:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    return True


@njit
def solve(factor: NDArray[np.float64], right: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """The solution of the system whose matrix has this lower factor."""
    size = len(right)
    for i in range(size):
        total = right[i]
        for k in range(i):
            total -= factor[i, k] * out[k]
        out[i] = total / factor[i, i]
    for i in range(size - 1, -1, -1):
        total = out[i]
        for k in range(i + 1, size):
            total -= factor[k, i] * out[k]
        out[i] = total / factor[i, i]
