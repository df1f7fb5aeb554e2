"""How well two layers of labels agree: two annotators, or one annotator's first look and a blind second one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labels.arrays import SOURCES, STATES, LabelArrays
from labels.model import PositionSource

Array = NDArray[np.float64]
RESAMPLES = 1000


@dataclass(frozen=True, slots=True)
class Agreement:
    """How far two agree at the times that both have looked at. Ratios and statistics of nothing are nan."""

    common: int
    only_first: int
    only_second: int
    same_state: int
    kappa: float
    """Cohen's kappa of the states: 1 always the same, 0 no better than chance; nan if both only ever say one thing."""
    both_seen: int
    mean_px: float
    median_px: float
    """Of the distances between the two positions."""
    median_low_px: float
    median_high_px: float
    """95 % interval of the median, by bootstrap."""
    p95_px: float
    bias_x_px: float
    bias_y_px: float
    """Second minus first."""
    sigma_px: float
    """Standard deviation of one annotator's coordinate, if both are equally exact: robust, and by both coordinates."""
    confusion: tuple[tuple[int, ...], ...]
    """[first][second] counts of states, in the order of `labels.arrays.STATES`."""


def made_independently(labels: LabelArrays) -> LabelArrays:
    """Those of a layer that settle no conflict: whoever made one of these had the other's label in sight."""
    return labels.rows(labels.source != SOURCES.index(PositionSource.SETTLED))


def measure_agreement(first: LabelArrays, second: LabelArrays, *, seed: int = 0) -> Agreement:
    """Compare two layers at the times they share."""
    common, rows_1, rows_2 = np.intersect1d(first.t_us, second.t_us, return_indices=True)
    a, b = first.rows(rows_1), second.rows(rows_2)
    confusion = np.zeros((len(STATES), len(STATES)), np.int64)
    np.add.at(confusion, (a.state, b.state), 1)
    both = a.seen & b.seen
    dx, dy = (b.x_px - a.x_px)[both], (b.y_px - a.y_px)[both]
    distance = np.hypot(dx, dy)
    low, high = _median_interval(distance, np.random.default_rng(seed))
    return Agreement(
        common=len(common),
        only_first=len(first) - len(common),
        only_second=len(second) - len(common),
        same_state=int(np.trace(confusion)),
        kappa=_kappa(confusion),
        both_seen=int(both.sum()),
        mean_px=_of(np.mean, distance),
        median_px=_of(np.median, distance),
        median_low_px=low,
        median_high_px=high,
        p95_px=_of(lambda values: np.percentile(values, 95), distance),
        bias_x_px=_of(np.mean, dx),
        bias_y_px=_of(np.mean, dy),
        sigma_px=_robust_sigma(np.concatenate([dx, dy])) / np.sqrt(2),
        confusion=tuple(tuple(row) for row in confusion.tolist()),
    )


def _kappa(confusion: NDArray[np.int64]) -> float:
    total = confusion.sum()
    if not total:
        return float("nan")
    observed = np.trace(confusion) / total
    chance = float(confusion.sum(axis=0) @ confusion.sum(axis=1)) / float(total) ** 2
    return float("nan") if chance >= 1 else float((observed - chance) / (1 - chance))


def _robust_sigma(values: Array) -> float:
    """From the median absolute value about the median: a few slips do not count as noise."""
    if not len(values):
        return float("nan")
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def _median_interval(distance: Array, rng: np.random.Generator) -> tuple[float, float]:
    if len(distance) < 2:
        return float("nan"), float("nan")
    medians = [float(np.median(rng.choice(distance, len(distance)))) for _ in range(RESAMPLES)]
    low, high = np.percentile(medians, (2.5, 97.5))
    return float(low), float(high)


def _of(statistic: Callable[[Array], np.floating], values: Array) -> float:
    return float(statistic(values)) if len(values) else float("nan")
