"""Figures of a method from its answers to labels, and between what they lie.

Labels of one ball are alike: what befalls one befalls its neighbours. Intervals therefore count balls, not labels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.metrics import WindowAnswers
from core.metrics.intervals import binomial_interval
from core.metrics.score import MATCH_RADIUS_PX
from labels.arrays import SOURCES, LabelArrays
from labels.score import GROUPS, pooled, score_groups

Array = NDArray[np.float64]
BALL_GAP_US: Final = 100_000
"""So long without a label of any camera, and the next one is of another ball."""
FEWEST_BALLS: Final = 3
"""For an interval of the errors."""
RESAMPLES: Final = 1000


@dataclass(frozen=True, slots=True, eq=False)
class AnsweredLayer:
    """What a method said at the labels of one layer."""

    answers: WindowAnswers
    labels: LabelArrays
    """Those asked about, a row for each answer."""
    ball: NDArray[np.int64]
    """The number of the ball of each label, the same in all cameras of a recording."""
    cpu_ms: Array
    """Processor time of the steps that answered, those before the labels among them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnBallsRow:
    """A method against labels of one kind, by one annotator. Errors are of answers within 8 px; nan of nothing."""

    method: str
    annotator: str
    group: str
    """Which labels, as in `labels.score.GROUPS`."""
    labels: int
    balls: int
    """That these labels are of."""
    precision: float
    """Share of the answers at labels that are the ball."""
    precision_low: float
    precision_high: float
    recall: float
    """Share of the labels with a ball that have an answer."""
    recall_low: float
    recall_high: float
    error_mean_px: float
    error_median_px: float
    error_median_low_px: float
    error_median_high_px: float
    error_p95_px: float
    error_p95_low_px: float
    error_p95_high_px: float
    along_px: float
    """Mean error along the ball's motion: the delay times the speed."""
    cpu_p50_ms: float
    cpu_p99_ms: float


def ball_numbers(times_us: Sequence[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """For the label times of each camera, ascending, the number of the ball: it begins anew after `BALL_GAP_US`."""
    together = np.unique(np.concatenate([*times_us, np.empty(0, np.int64)]))
    number = np.concatenate([[0], np.cumsum(np.diff(together) > BALL_GAP_US)])
    return [number[np.searchsorted(together, times)] for times in times_us]


def rows_of(method: str, annotator: str, layers: Sequence[AnsweredLayer], *, kinds: bool = True) -> list[OwnBallsRow]:
    """All labels first, then those of each kind that there are, unless only all of them are asked for."""
    asked = [layer for layer in layers if len(layer.labels)]
    if not asked:
        return []
    answers, labels = pooled([(layer.answers, layer.labels) for layer in asked])
    ball = np.concatenate([layer.ball for layer in asked])
    error_px = np.hypot(answers.u_px - labels.x_px, answers.v_px - labels.y_px)
    right = labels.seen & (np.nan_to_num(error_px, nan=np.inf) <= MATCH_RADIUS_PX)
    cpu_ms = np.concatenate([layer.cpu_ms for layer in asked])
    p50_ms, p99_ms = (np.percentile(cpu_ms, (50, 99)) if len(cpu_ms) else np.full(2, np.nan)).tolist()
    rows = []
    for score in score_groups(answers, labels)[: None if kinds else 1]:
        mine = np.isin(labels.source, [SOURCES.index(source) for source in GROUPS[score.group]])
        at = score.at[-1]  # MATCH_RADIUS_PX, as of the simulated recordings
        precision_low, precision_high = _share_interval(at.precision, ball[mine & answers.detected])
        recall_low, recall_high = _share_interval(at.recall, ball[mine & labels.seen])
        (median_low, median_high), (p95_low, p95_high) = error_intervals(error_px[mine & right], ball[mine & right])
        rows.append(
            OwnBallsRow(
                method=method,
                annotator=annotator,
                group=score.group,
                labels=score.labels,
                balls=len(np.unique(ball[mine])),
                precision=at.precision,
                precision_low=precision_low,
                precision_high=precision_high,
                recall=at.recall,
                recall_low=recall_low,
                recall_high=recall_high,
                error_mean_px=score.mean_px,
                error_median_px=score.median_px,
                error_median_low_px=median_low,
                error_median_high_px=median_high,
                error_p95_px=score.p95_px,
                error_p95_low_px=p95_low,
                error_p95_high_px=p95_high,
                along_px=score.along_px,
                cpu_p50_ms=p50_ms,
                cpu_p99_ms=p99_ms,
            )
        )
    return rows


def _share_interval(share: float, ball: NDArray[np.int64]) -> tuple[float, float]:
    """Wilson's, as if each ball had been asked about once."""
    return (math.nan, math.nan) if math.isnan(share) else binomial_interval(share, len(np.unique(ball)))


def error_intervals(error_px: Array, ball: NDArray[np.int64]) -> tuple[tuple[float, float], tuple[float, float]]:
    """95 % bootstrap intervals of the median and of the 95th percentile (px): whole balls are drawn with replacement.

    nan of fewer than `FEWEST_BALLS`.
    """
    numbers = np.unique(ball)
    if len(numbers) < FEWEST_BALLS:
        return (math.nan, math.nan), (math.nan, math.nan)
    of_ball = [error_px[ball == number] for number in numbers]
    rng = np.random.default_rng(0)
    drawn = np.array([
        np.percentile(np.concatenate([of_ball[one] for one in rng.integers(0, len(of_ball), len(of_ball))]), (50, 95))
        for _ in range(RESAMPLES)
    ])  # fmt: skip
    (median_low, p95_low), (median_high, p95_high) = np.percentile(drawn, (2.5, 97.5), axis=0).tolist()
    return (median_low, median_high), (p95_low, p95_high)
