"""How far each position is from where its neighbours in time say it should be, robust against bad neighbours."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SIDE = 4
LEAST = 3
"""Neighbours on one side that say where a ball comes from, or goes to."""
"""Neighbours on either side that have a say."""


def residual_of_neighbours(t_us: NDArray[np.int64], x_px: Array, y_px: Array, *, max_gap_us: int) -> Array:
    """(N,) pixels from the median of what parabolas through triples of neighbours predict; nan with too few of them.

    A median of many predictions holds while less than about a third of the neighbours are wrong.
    """
    count = len(t_us)
    places = np.column_stack([x_px, y_px])
    neighbours = np.arange(count)[:, None] + [k for k in range(-SIDE, SIDE + 1) if k]
    inside = (neighbours >= 0) & (neighbours < count)
    neighbours = np.clip(neighbours, 0, max(count - 1, 0))
    since = (t_us[neighbours] - t_us[:, None]).astype(np.float64) if count else np.empty((0, 2 * SIDE))
    inside &= np.abs(since) <= max_gap_us * SIDE
    predictions = []
    for triple in combinations(range(2 * SIDE), 3):
        use = list(triple)
        t, p = since[:, use], places[neighbours[:, use]]
        fine = inside[:, use].all(axis=1)
        # Lagrange's parabola at time 0.
        weights = [
            (t[:, j] * t[:, k]) / np.where(fine, (t[:, i] - t[:, j]) * (t[:, i] - t[:, k]), 1.0)
            for i, j, k in ((0, 1, 2), (1, 0, 2), (2, 0, 1))
        ]
        # One that extrapolates far says little: leave it out.
        steady = np.sum(np.abs(weights), axis=0) < 4.0
        value = sum(weight[:, None] * p[:, i] for i, weight in enumerate(weights))
        predictions.append(np.where((fine & steady)[:, None], value, np.nan))
    stack = np.array(predictions)
    enough = np.isfinite(stack[:, :, 0]).sum(axis=0) >= 2
    middle = np.full((count, 2), np.nan)
    if enough.any():
        middle[enough] = np.nanmedian(stack[:, enough], axis=0)
    return np.linalg.norm(places - middle, axis=1)


def residual_of_one_side(t_us: NDArray[np.int64], x_px: Array, y_px: Array, row: int, *, max_gap_us: int) -> float:
    """Distance of a position from the path before it or that behind it, whichever is nearer, px; nan without either.

    At a bounce or a hit a position fits one of them; one that is wrong fits neither.
    """
    places, found = np.column_stack([x_px, y_px]), [float("nan")]
    for rows in (np.arange(max(row - SIDE, 0), row), np.arange(row + 1, min(row + 1 + SIDE, len(t_us)))):
        rows = rows[np.abs(t_us[rows] - t_us[row]) <= max_gap_us * SIDE]
        if len(rows) < LEAST:
            continue
        since_ms = (t_us[rows] - t_us[row]) * 1e-3
        at = [np.polyfit(since_ms, places[rows, axis], 2 if len(rows) > LEAST else 1)[-1] for axis in (0, 1)]
        found.append(float(np.hypot(*(places[row] - at))))
    return float(np.nanmin(found)) if len(found) > 1 else float("nan")
