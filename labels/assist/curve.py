"""A smooth curve through labelled positions in the picture, which never crosses a bounce, a hit or a lost ball."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import check_settings, setting
from labels.arrays import LabelArrays

Array = NDArray[np.float64]
NOT_COVERED = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveConfig:
    """How keyframes are joined."""

    neighbours: int = setting(6, 4, 20)
    """Keyframes that a position rests on, half of them on each side."""
    degree: int = setting(3, 1, 5)
    """Degree of the local polynomials: with 6 keyframes, 3 follows perspective and still averages over their noise."""
    max_gap_us: int = setting(120_000, 1000, 1_000_000)
    """Keyframes farther apart are not joined."""
    keyframe_sigma_px: float = setting(0.5, 0.05, 5.0)
    """How exact a keyframe is taken to be."""
    break_sigmas: float = setting(3.0, 2.0, 30.0)
    """A curve that misses its own keyframes by so much has a bounce or a hit in it."""
    least_keyframes: int = setting(5, 2, 20)
    """Fewer are not joined: any four points of a bounce lie on some parabola."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Positions at N wanted times; nan and segment `NOT_COVERED` where nothing may be interpolated."""

    t_us: NDArray[np.int64]
    x_px: Array
    y_px: Array
    r_px: Array
    sigma_px: Array
    """Standard deviation of a coordinate, from the keyframes' exactness and their scatter about the curve."""
    segment: NDArray[np.intp]

    @property
    def covered(self) -> NDArray[np.bool_]:
        return self.segment != NOT_COVERED


def interpolate(
    keys: LabelArrays, t_us: ArrayLike, *, breaks_us: Sequence[int] = (), config: CurveConfig | None = None
) -> Curve:
    """Positions at the times `t_us` from the labels of visible balls among `keys`.

    Nothing is interpolated beyond the first and last keyframe of a segment. Segments end at `breaks_us` (bounces and
    hits that a person marked), at breaks found in the keyframes, at gaps, and at labels of hidden or absent balls.

    Args:
        keys: the labels.
        t_us: (N,) times that are asked for.
        breaks_us: times at which segments end.
        config: gaps, and how many labels a segment needs.
    """
    config = config or CurveConfig()
    times = np.atleast_1d(np.asarray(t_us, np.int64))
    segments = split_segments(keys, breaks_us=breaks_us, config=config)
    x, y, r, sigma = np.full((4, len(times)), np.nan)
    segment = np.full(len(times), NOT_COVERED, np.intp)
    for number, rows in enumerate(segments):
        part = keys.rows(rows)
        inside = np.flatnonzero((part.t_us[0] <= times) & (times <= part.t_us[-1]))
        if not len(inside) or len(rows) < config.least_keyframes:
            continue
        values = np.column_stack([part.x_px, part.y_px])
        place, spread = _local_fit(part.t_us, values, times[inside], config)
        x[inside], y[inside], sigma[inside] = place[:, 0], place[:, 1], spread
        # Labels of points have no radius; between those that have one it changes slowly.
        known = np.isfinite(part.r_px)
        if known.any():
            r[inside] = np.interp(times[inside], part.t_us[known], part.r_px[known])
        segment[inside] = number
    return Curve(times, x, y, r, sigma, segment)


def split_segments(
    keys: LabelArrays, *, breaks_us: Sequence[int] = (), config: CurveConfig | None = None
) -> list[NDArray[np.intp]]:
    """Rows of `keys` with visible balls, cut wherever a curve must not go on."""
    config = config or CurveConfig()
    rows = np.flatnonzero(keys.seen & np.isfinite(keys.x_px))
    if not len(rows):
        return []
    t = keys.t_us[rows]
    cut = (np.diff(t) > config.max_gap_us) | (np.diff(rows) > 1)  # a row in between is a label of no visible ball
    for break_us in breaks_us:
        cut |= (t[:-1] <= break_us) & (break_us < t[1:])
    segments: list[NDArray[np.intp]] = []
    for part in np.split(rows, np.flatnonzero(cut) + 1):
        found = find_breaks(keys.t_us[part], np.column_stack([keys.x_px[part], keys.y_px[part]]), config)
        segments += np.split(part, np.asarray(found, np.intp) + 1)
    return segments


def find_breaks(t_us: NDArray[np.int64], places: Array, config: CurveConfig | None = None) -> list[int]:
    """Numbers of the gaps (between keyframes k and k + 1) in which velocity jumps: bounces and hits.

    A parabola through three keyframes on either side fits them; one across a bounce does not. Keyframes far apart miss
    parabolas everywhere, so the tolerance grows with the usual miss. Of neighbouring gaps that look broken, the one is
    taken whose two sides fit best without each other.
    """
    config = config or CurveConfig()
    first = [min(max(gap - 2, 0), max(len(t_us) - 6, 0)) for gap in range(len(t_us) - 1)]
    misfit = np.array([_misfit(t_us, places, start, start + 6, 2) for start in first])
    usual = float(np.quantile(misfit, 0.2)) if len(misfit) >= 8 else 0.0  # of a few, all may be the bounce itself
    suspect = misfit > config.break_sigmas * max(config.keyframe_sigma_px, usual)
    breaks: list[int] = []
    for run in np.split(np.flatnonzero(suspect), np.flatnonzero(np.diff(np.flatnonzero(suspect)) > 1) + 1):
        remaining = [int(gap) for gap in run]
        while remaining:
            costs = [
                _misfit(t_us, places, gap - 3, gap + 1, 2) + _misfit(t_us, places, gap + 1, gap + 5, 2)
                for gap in remaining
            ]
            best = remaining[int(np.argmin(costs))]
            breaks.append(best)
            # Gaps whose six keyframes include this break were suspect because of it.
            remaining = [gap for gap in remaining if abs(gap - best) > 3]
    return sorted(breaks)


def _misfit(t_us: NDArray[np.int64], places: Array, first: int, last: int, degree: int) -> float:
    """Root mean square miss, per degree of freedom, of a polynomial through keyframes [first, last)."""
    first, last = max(first, 0), min(last, len(t_us))
    free = last - first - degree - 1
    if free < 1:
        return 0.0
    t = (t_us[first:last] - t_us[first]) / max(float(t_us[last - 1] - t_us[first]), 1.0)
    design = np.vander(t, degree + 1)
    residual = places[first:last] - design @ np.linalg.lstsq(design, places[first:last], rcond=None)[0]
    return float(np.sqrt((residual**2).sum() / (2 * free)))


def _local_fit(
    t_us: NDArray[np.int64], values: Array, at_us: NDArray[np.int64], config: CurveConfig
) -> tuple[Array, Array]:
    """Values and standard deviation at each time, from a polynomial through the nearest keyframes."""
    count = min(config.neighbours, len(t_us))
    degree = min(config.degree, count - 1)
    after = np.searchsorted(t_us, at_us, side="right")
    first = np.clip(after - count // 2, 0, len(t_us) - count)
    result, sigma = np.empty((len(at_us), values.shape[1])), np.empty(len(at_us))
    for start in np.unique(first):
        here = first == start
        t = t_us[start : start + count]
        middle, span = t.mean(), max(float(t[-1] - t[0]) / 2, 1.0)
        design = np.vander((t - middle) / span, degree + 1)
        wanted = np.vander((at_us[here] - middle) / span, degree + 1)
        weights = wanted @ np.linalg.pinv(design)
        result[here] = weights @ values[start : start + count]
        free = count - degree - 1
        scatter = 0.0
        if free:
            fitted = design @ np.linalg.lstsq(design, values[start : start + count], rcond=None)[0]
            scatter = float(np.sqrt(((fitted - values[start : start + count]) ** 2).sum() / (2 * free)))
        sigma[here] = np.sqrt((weights**2).sum(axis=1)) * max(scatter, config.keyframe_sigma_px)
    return result, sigma
