"""Scores on a grid of times, for detectors whose answers have times of their own.

`core.metrics.score` asks once a window; here every whole millisecond asks, whatever the windows, so that detectors with
different ones are compared on the same times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.metrics.run import WindowAnswers
from core.metrics.score import MATCH_RADIUS_PX
from core.recordings import PixelTruth

GRID_US: Final = 1000
SETTLING_US: Final = 10_000
"""Time that a detector gets when a ball appears or comes out of an occlusion."""
SLOW_PX_PER_MS: Final = 2.0
"""Slower balls are scored apart. Chosen by hand; not measured."""
LAG_FROM_PX_PER_MS: Final = 0.5
"""Slowest ball that tells a lag: half a pixel off is a millisecond there."""


@dataclass(frozen=True, slots=True, eq=False)
class GridScore:
    """Counts and errors that add up over cameras and recordings."""

    asked: int = 0
    """Times of the grid with the whole disc in view, in the range of speeds."""
    found: int = 0
    answers: int = 0
    false: int = 0
    """Answers without a ball within the match radius at their own time, at any speed."""
    error_px: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """Errors of the answers that match, in the range of speeds."""
    along_px: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """Signed error of these along the ball's motion, px."""
    speed_px_per_ms: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def precision(self) -> float:
        """Share of the answers that are a ball."""
        return 1.0 - self.false / self.answers if self.answers else float("nan")

    @property
    def recall(self) -> float:
        """Share of the query times that have an answer."""
        return self.found / self.asked if self.asked else float("nan")

    def error_at(self, percent: float) -> float:
        """Percentile of the errors in pixels."""
        return float(np.percentile(self.error_px, percent)) if len(self.error_px) else float("nan")

    def __add__(self, other: GridScore) -> GridScore:
        return GridScore(
            self.asked + other.asked,
            self.found + other.found,
            self.answers + other.answers,
            self.false + other.false,
            np.concatenate([self.error_px, other.error_px]),
            np.concatenate([self.along_px, other.along_px]),
            np.concatenate([self.speed_px_per_ms, other.speed_px_per_ms]),
        )


def lag_ms(score: GridScore) -> float:
    """Median time by which answers lag behind the ball, ms; 0 if there are none.

    The part of an error along the ball's motion, over its speed. Sensor and method have one such delay together, which
    is no error of the place: with the truth of a recording at hand it is taken out of every method alike.
    """
    telling = score.speed_px_per_ms >= LAG_FROM_PX_PER_MS
    if not telling.any():
        return 0.0
    return float(-np.median(score.along_px[telling] / score.speed_px_per_ms[telling]))


def errors_without_lag(score: GridScore, lag_ms: float) -> NDArray[np.float64]:
    """(N,) errors in px as they would be with answers dated back by this lag."""
    along = score.along_px + lag_ms * score.speed_px_per_ms
    across_squared = np.maximum(score.error_px**2 - score.along_px**2, 0.0)
    return np.sqrt(along**2 + across_squared)


def score_on_grid(
    answers: WindowAnswers,
    truth: PixelTruth,
    sensor: SensorSize,
    speeds_px_per_ms: tuple[float, float],
    *,
    window_us: int,
    match_radius_px: float = MATCH_RADIUS_PX,
    counts: Callable[[NDArray[np.int64]], NDArray[np.bool_]] | None = None,
) -> GridScore:
    """Compare answers with the truth: recall and errors of balls whose image moves in that range of speeds.

    A time is found with an answer within half a window of it, or half a step of the grid if that is more. Only times
    (N,) where `counts` is true, of the grid and of the answers, are asked and counted; without it all of them.

    Args:
        answers: of a detector, a row per window.
        truth: centre and radius of the ball over time.
        sensor: size of the picture.
        speeds_px_per_ms: from, and below, which speed of the image balls are asked for.
        window_us: length of the detector's windows.
        match_radius_px: distance up to which an answer is right.
        counts: whether times (N,), us, are asked and counted.
    """
    low, high = speeds_px_per_ms
    grid = np.arange(truth.t_us[0], truth.t_us[-1], GRID_US) if len(truth.t_us) else np.empty(0, np.int64)
    wanted = askable(grid, truth, sensor)
    speed = image_velocity(truth, grid)
    speed = np.hypot(speed[:, 0], speed[:, 1])
    wanted &= (low <= speed) & (speed < high)
    if counts is not None:
        wanted &= counts(grid)

    within = np.zeros(len(answers.t_us), np.bool_)
    if len(truth.t_us):
        within = answers.detected & (answers.t_us >= truth.t_us[0]) & (answers.t_us <= truth.t_us[-1])
    t_us, u, v = answers.t_us[within], answers.u_px[within], answers.v_px[within]
    there = truth.at(t_us)
    off_u, off_v = u - there.u_px, v - there.v_px
    error = np.hypot(off_u, off_v)
    match = there.visible & (np.nan_to_num(error, nan=np.inf) <= match_radius_px)
    nearest = distance_us(grid, t_us[match])
    if counts is not None:
        mine = counts(t_us)
        t_us, match, error, off_u, off_v = t_us[mine], match[mine], error[mine], off_u[mine], off_v[mine]
    moving = image_velocity(truth, t_us[match])
    fast = np.hypot(moving[:, 0], moving[:, 1])
    # False answers count at every speed: where there is no ball there is none.
    counted = (low <= fast) & (fast < high)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = (off_u[match] * moving[:, 0] + off_v[match] * moving[:, 1]) / fast
    return GridScore(
        asked=int(wanted.sum()),
        found=int((wanted & (nearest <= max(GRID_US, window_us) // 2)).sum()),
        answers=len(t_us),
        false=int((~match).sum()),
        error_px=error[match][counted],
        along_px=along[counted],
        speed_px_per_ms=fast[counted],
    )


def distance_us(grid: NDArray[np.int64], t_us: NDArray[np.int64]) -> NDArray[np.int64]:
    """Distance from each time of the grid to the nearest of the other times; very large without any."""
    if not len(t_us):
        return np.full(len(grid), np.iinfo(np.int64).max)
    ordered = np.sort(t_us)
    after = np.searchsorted(ordered, grid)
    later, earlier = ordered[np.minimum(after, len(ordered) - 1)], ordered[np.maximum(after - 1, 0)]
    return np.minimum(np.abs(later - grid), np.abs(grid - earlier))


def image_velocity(truth: PixelTruth, t_us: NDArray[np.int64], *, over_us: int = 1000) -> NDArray[np.float64]:
    """(N, 2) px/ms at times (N,), over the previous millisecond; over the next one at the start."""
    now, before, after = truth.at(t_us), truth.at(t_us - over_us), truth.at(t_us + over_us)
    back = np.column_stack([now.u_px - before.u_px, now.v_px - before.v_px])
    on = np.column_stack([after.u_px - now.u_px, after.v_px - now.v_px])
    return np.nan_to_num(np.where(before.visible[:, None], back, on) * (1000.0 / over_us))


def askable(grid: NDArray[np.int64], truth: PixelTruth, sensor: SensorSize) -> NDArray[np.bool_]:
    """(N,) whether a detector is expected to answer at times (N,): the whole disc has been in view for a while."""
    fine = np.arange(truth.t_us[0], truth.t_us[-1] + 1, GRID_US // 4) if len(truth.t_us) else grid
    whole = wholly_in_view(truth.at(fine), sensor)
    last_without = np.maximum.accumulate(np.where(whole, truth.t_us[:1], fine))
    row = np.searchsorted(fine, grid)
    return whole[row] & (grid - last_without[row] > SETTLING_US)


def wholly_in_view(at: PixelTruth, sensor: SensorSize) -> NDArray[np.bool_]:
    """(N,) whether the whole ball is visible and inside the picture."""
    with np.errstate(invalid="ignore"):
        return (
            at.visible
            & (at.u_px >= at.r_px)
            & (at.u_px <= sensor.width_px - 1 - at.r_px)
            & (at.v_px >= at.r_px)
            & (at.v_px <= sensor.height_px - 1 - at.r_px)
        )
