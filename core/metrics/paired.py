"""Two things compared on the same seeds: difference or ratio with its interval, and Holm's correction for many claims.

The differences are judged by the paired t-test, the ratios by the same test on the logarithms of the ratios seed by
seed (exact where these are normal; the ratio is then the geometric mean over the seeds). Both from scipy.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from core.errors import ConfigError

Array = NDArray[np.float64]
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """Difference or ratio of pairs; no interval and no p for fewer than two."""

    count: int
    """Number of pairs."""
    estimate: float
    low: float
    """Lower end of the 95 % interval."""
    high: float
    p: float
    """Two-sided p-value of the null value."""


def pair_by_seed(
    ours: Mapping[int, float], theirs: Mapping[int, float], *, where: str
) -> tuple[tuple[int, ...], Array, Array]:
    """Seeds (N,) in rising order, and the values of both sides in that order.

    Raises:
        ConfigError: if the seeds of the two sides are not the same.
    """
    if ours.keys() != theirs.keys():
        raise ConfigError(
            "not compared, the seeds differ",
            expected=f"the same seeds on both sides, here {seeds_as_text(ours.keys())}",
            got=seeds_as_text(theirs.keys()),
            where=where,
            remedy="train the seeds that are missing",
        )
    seeds = tuple(sorted(ours))
    return seeds, np.array([ours[s] for s in seeds], np.float64), np.array([theirs[s] for s in seeds], np.float64)


def paired_difference(ours: Array, theirs: Array, null: float = 0.0) -> PairedComparison:
    """Mean of ours - theirs (N,) with Student's interval, and the t-test of a mean of `null`."""
    return _t_test(np.asarray(ours, np.float64) - np.asarray(theirs, np.float64), null)


def paired_ratio(ours: Array, theirs: Array, null: float = 1.0) -> PairedComparison:
    """Geometric mean of ours / theirs (N,), all above 0, with its interval, and the t-test of a ratio of `null`.

    Raises:
        ConfigError: if a value is not above 0.
    """
    if not (np.min(ours, initial=1.0) > 0 and np.min(theirs, initial=1.0) > 0):
        raise ConfigError("no ratio of these", expected="values above 0", got=[*ours, *theirs])
    found = _t_test(np.log(ours) - np.log(theirs), math.log(null))
    return PairedComparison(found.count, math.exp(found.estimate), math.exp(found.low), math.exp(found.high), found.p)


def holm(ps: Sequence[float]) -> list[float]:
    """The p-values of a family, adjusted so that the chance of any false claim stays (Holm 1979); NaN is no member.

    The smallest of m is multiplied by m, the next by m - 1, and so on; none falls below a smaller one before it.
    """
    members = [i for i, p in enumerate(ps) if not math.isnan(p)]
    adjusted, highest = [math.nan] * len(ps), 0.0
    for rank, i in enumerate(sorted(members, key=lambda i: ps[i])):
        highest = max(highest, min(1.0, (len(members) - rank) * ps[i]))
        adjusted[i] = highest
    return adjusted


def seeds_as_text(seeds: Iterable[int]) -> str:
    """Seeds with runs of them drawn together: 0-4, 7."""
    found = sorted(seeds)
    parts: list[str] = []
    start = 0
    for i, seed in enumerate(found):
        if i + 1 == len(found) or found[i + 1] != seed + 1:
            parts.append(str(seed) if start == i else f"{found[start]}-{seed}")
            start = i + 1
    return ", ".join(parts) or "none"


def _t_test(values: Array, null: float) -> PairedComparison:
    count = len(values)
    if count < 2:
        return PairedComparison(count, float(values.mean()) if count else math.nan, math.nan, math.nan, math.nan)
    mean = float(values.mean())
    if np.ptp(values) <= 1e-12 * max(1.0, abs(mean)):  # no scatter: no test
        return PairedComparison(count, mean, mean, mean, 1.0 if math.isclose(mean, null, abs_tol=1e-12) else 0.0)
    test: Any = stats.ttest_1samp(values, null)  # scipy has no types for it
    interval = test.confidence_interval(CONFIDENCE)
    return PairedComparison(count, mean, float(interval.low), float(interval.high), float(test.pvalue))
