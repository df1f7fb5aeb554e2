"""How well two layers of labels agree: two annotators, or one annotator's first look and a blind second one.

Positions are compared by how they came about, too: two clicks that were snapped to the same events are the same circle,
and two accepted proposals the same answer. Only positions set by hand in both layers tell how exact a person is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.metrics.score import statistic_of
from labels.arrays import SOURCES, STATES, LabelArrays
from labels.model import PositionSource

Array = NDArray[np.float64]
RESAMPLES = 1000
"""Resamples of the bootstrap."""
SAME_PX: Final = 1e-6
"""Two positions nearer than this are one number that was taken twice."""
_GROUPS: Final[Mapping[str, tuple[PositionSource, ...]]] = {
    "by_hand": (PositionSource.BY_HAND, PositionSource.EPIPOLAR),
    "snapped": (PositionSource.SNAPPED,),
    "proposed": (PositionSource.ACCEPTED, PositionSource.CORRECTED, PositionSource.INTERPOLATED),
    "other": (PositionSource.IMPORTED, PositionSource.SETTLED),
}
"""Groups of pairs, the most independent first: a pair belongs to the group of its less independent label."""


@dataclass(frozen=True, slots=True)
class PositionAgreement:
    """Distances between the positions of pairs that came about in one way. Statistics of nothing are nan."""

    pairs: int
    same_position: int
    """Pairs with one position to the last digit: made once and taken twice."""
    median_px: float
    p95_px: float
    sigma_px: float
    """As in `Agreement`."""


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
    """Median of the distances between the two positions."""
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
    by_source: Mapping[str, PositionAgreement]
    """Agreement of those seen by both, by how the less independent position of a pair came about: by_hand, snapped (at
    least one was moved to the circle that fits the events), proposed (at least one was a detector's or interpolated),
    other (imported, or settled)."""

    @property
    def by_hand(self) -> PositionAgreement:
        """Pairs of positions that were both set by hand: the only ones that tell how exact a person is."""
        return self.by_source["by_hand"]


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
        mean_px=statistic_of(distance, np.mean),
        median_px=statistic_of(distance, np.median),
        median_low_px=low,
        median_high_px=high,
        p95_px=statistic_of(distance, lambda values: np.percentile(values, 95)),
        bias_x_px=statistic_of(dx, np.mean),
        bias_y_px=statistic_of(dy, np.mean),
        # The difference of two annotators has the variance of both: this is one's.
        sigma_px=_robust_sigma(np.concatenate([dx, dy])) / np.sqrt(2),
        confusion=tuple(tuple(row) for row in confusion.tolist()),
        by_source=_by_source(a.rows(both), b.rows(both)),
    )


def _by_source(a: LabelArrays, b: LabelArrays) -> dict[str, PositionAgreement]:
    """Pairs in which both have seen the ball, row by row, grouped by their less independent position."""
    rank_of = np.array([[source in group for group in _GROUPS.values()].index(True) for source in SOURCES])
    rank = np.maximum(rank_of[a.source], rank_of[b.source])
    dx, dy = b.x_px - a.x_px, b.y_px - a.y_px
    found = {}
    for number, name in enumerate(_GROUPS):
        x, y = dx[rank == number], dy[rank == number]
        distance = np.hypot(x, y)
        found[name] = PositionAgreement(
            pairs=len(distance),
            same_position=int((distance < SAME_PX).sum()),
            median_px=statistic_of(distance, np.median),
            p95_px=statistic_of(distance, lambda values: np.percentile(values, 95)),
            sigma_px=_robust_sigma(np.concatenate([x, y])) / np.sqrt(2),
        )
    return found


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
