"""Votes of the circles in a surface, those too few for an answer as well.

`cv2.HoughCircles` tells only which circles have more votes than asked for. To name the votes of the best circle one
would have to ask again and again with less. This counts them in one pass, by the rules of OpenCV's HOUGH_GRADIENT: the
edges of Canny vote for centres along their gradient, then for a radius by their distance from a centre.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection.ebpp_config import EbppConfig
from core.jit import njit

CENTRES: Final = 40
"""Most centres whose radius is estimated."""
SHIFT: Final = 10
"""Bits of the fraction of a step along the gradient, as in OpenCV."""
BINS: Final = 10
"""Bins of the distances in one cell, as in OpenCV."""

VotedCircles = NDArray[np.float64]
"""(N, 4) u_px, v_px, r_px and votes, the most votes first."""


def voted_circles(blurred: NDArray[np.uint8], config: EbppConfig, votes_min: float) -> VotedCircles:
    """The circles of a blurred surface (height, width) with at least so many votes, no two closer than two radii.

    A circle's votes are the fewer of those for its centre and for its radius: both must exceed the limit.
    """
    # As HoughCircles does it: 16-bit derivatives of Sobel, the lower threshold half of the upper one.
    dx, dy = cv2.spatialGradient(blurred, ksize=3, borderType=cv2.BORDER_REPLICATE)
    edges = cv2.findNonZero(cv2.Canny(dx, dy, max(1, int(config.canny_high) // 2), int(config.canny_high)))
    if edges is None or len(edges) < votes_min:
        return np.empty((0, 4))
    columns, rows = edges.reshape(-1, 2).astype(np.int64).T
    radii = config.radius_min_px, config.radius_max_px
    cells = math.ceil(blurred.shape[0] / config.cell_px), math.ceil(blurred.shape[1] / config.cell_px)
    votes_by_cell, many = _vote_for_centres(
        rows, columns, dx[rows, columns], dy[rows, columns], config.cell_px, radii, cells, max(votes_min, 1.0)
    )
    voted: list[tuple[float, float, float, float]] = []
    for row, column in _peaks(votes_by_cell, many):
        u, v = (column + 0.5) * config.cell_px, (row + 0.5) * config.cell_px
        r, votes = _vote_for_radius(rows, columns, u, v, config.cell_px, radii)
        voted.append((u, v, r, min(votes, float(votes_by_cell[row, column]))))
    found: list[tuple[float, float, float, float]] = []
    for one in sorted(voted, key=lambda one: -one[3]):
        apart = all(math.hypot(one[0] - other[0], one[1] - other[1]) >= 2 * config.radius_min_px for other in found)
        if one[3] >= votes_min and apart:
            found.append(one)
    return np.array(found).reshape(-1, 4)


def _peaks(votes: NDArray[np.int32], cells: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Cells, of (N, 2) row and column, that have the most votes around, the largest first."""
    rows, columns = cells.T
    most, (height, width) = votes[rows, columns], votes.shape
    peak = np.ones(len(rows), np.bool_)
    # The four neighbours only, as in OpenCV: one on the diagonal may have fewer votes as a centre and more as a circle.
    for down, across in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        beside = np.clip(rows + down, 0, height - 1), np.clip(columns + across, 0, width - 1)
        peak &= votes[beside] <= most
    order = np.argsort(-most[peak], kind="stable")[:CENTRES]
    return list(zip(rows[peak][order].tolist(), columns[peak][order].tolist(), strict=True))


@njit
def _vote_for_centres(rows, columns, dx, dy, cell_px, radii, cells, votes_min):
    """Votes of the edge pixels along their gradients, in both directions, for each cell; and the cells with enough."""
    votes = np.zeros(cells, np.int32)
    enough = math.ceil(votes_min)
    many = np.empty((max(16, 2 * len(rows) * (radii[1] - radii[0] + 1) // enough), 2), np.int64)
    found, one = 0, 1 << SHIFT
    for k in range(len(rows)):
        slope = math.hypot(float(dx[k]), float(dy[k]))
        if slope == 0.0:
            continue
        step_x, step_y = round(dx[k] / cell_px * one / slope), round(dy[k] / cell_px * one / slope)
        x0, y0 = round(columns[k] / cell_px * one), round(rows[k] / cell_px * one)
        for sign in (1, -1):
            for r in range(radii[0], radii[1] + 1):
                x, y = (x0 + sign * r * step_x) >> SHIFT, (y0 + sign * r * step_y) >> SHIFT
                if not (0 <= x < cells[1] and 0 <= y < cells[0]):
                    break
                votes[y, x] += 1
                if votes[y, x] == enough:
                    many[found, 0], many[found, 1] = y, x
                    found += 1
    return votes, many[:found]


@njit
def _vote_for_radius(rows, columns, u, v, cell_px, radii):
    """The radius at which most edge pixels lie for their number, and how many do."""
    count = max(1, round((radii[1] - radii[0]) / cell_px * BINS))
    bins = np.zeros(count, np.int64)
    for k in range(len(rows)):
        distance = math.hypot(columns[k] - u, rows[k] - v)
        if radii[0] <= distance <= radii[1]:
            bins[max(0, min(count - 1, round((distance - radii[0]) / cell_px * BINS)))] += 1
    best, most = 0.0, 0
    outer = count - 1
    while outer > 0:
        if bins[outer] == 0:
            outer -= 1
            continue
        inner, near = outer, 0
        while inner > outer - BINS and inner >= 0:
            near += bins[inner]
            inner -= 1
        r = 0.5 * (outer + inner) / BINS * cell_px + radii[0]
        if near * best >= most * r or (best == 0.0 and near >= most):
            best, most = r, near
        outer = inner - 1
    return best, float(most)
