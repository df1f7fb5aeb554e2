"""Numbers over seeds as text: mean, standard deviation, 95 % interval, paired differences, and curves."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from core.bench.learning.runs import SeedResult, values_at
from core.bench.line_chart import ChartLine
from core.learning.runs.summary import SeedSpread, spread_of


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write rows as a Markdown table."""
    lines = ["| " + " | ".join(titles) + " |", "|" + " --- |" * len(titles)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def millimetres(values: Sequence[float]) -> str:
    """148 ± 31 [133, 162]; no distance is negative, and no interval of one."""
    spread = spread_of(values)
    return _spread(dataclasses.replace(spread, low=max(spread.low, 0.0)), 0 if spread.mean >= 30 else 1)


def percent(shares: Sequence[float]) -> str:
    """Shares 0..1 as percent: 98.4 ± 1.2 [97.8, 99.0]; the interval ends where percentages do."""
    spread = spread_of([100 * share for share in shares])
    return _spread(dataclasses.replace(spread, low=max(spread.low, 0.0), high=min(spread.high, 100.0)), 1)


def at(results: Sequence[SeedResult], episode: int, what: str) -> str:
    """The figure after so many episodes; what: returned, error_mm or error_returned_mm."""
    values = values_at(results, episode, what)
    return percent(values) if what == "returned" else millimetres(values)


def paired(a: Sequence[SeedResult], b: Sequence[SeedResult], episode: int, what: str) -> str:
    """Mean difference a - b over the seeds that both have (same balls), and whether its interval holds zero."""
    spread = paired_spread(a, b, episode, what)
    if spread.count < 2:
        return "-"
    verdict = "no difference shown" if spread.low <= 0 <= spread.high else "differs"
    return f"{spread.mean:+.1f} [{spread.low:+.1f}, {spread.high:+.1f}], {verdict}"


def paired_spread(a: Sequence[SeedResult], b: Sequence[SeedResult], episode: int, what: str) -> SeedSpread:
    """Differences a - b over the seeds that both have, in percentage points or millimetres."""
    of_b = {result.seed: result.at(episode) for result in b}
    differences = []
    for result in a:
        mine, other = result.at(episode), of_b.get(result.seed)
        if mine is not None and other is not None:
            differences.append(getattr(mine, what) - getattr(other, what))
    return spread_of([100 * d for d in differences] if what == "returned" else differences)


def curve(name: str, results: Sequence[SeedResult], what: str) -> ChartLine:
    """Mean and 95 % interval at every evaluation."""
    episodes = sorted({e.episode for result in results for e in result.evaluations})
    scale = 100.0 if what == "returned" else 1.0
    spreads = [spread_of([scale * value for value in values_at(results, episode, what)]) for episode in episodes]
    kept = [(episode, s) for episode, s in zip(episodes, spreads, strict=True) if s.count]
    return ChartLine(
        name,
        [episode for episode, _ in kept],
        [s.mean for _, s in kept],
        [s.mean if math.isnan(s.low) else s.low for _, s in kept],
        [s.mean if math.isnan(s.high) else s.high for _, s in kept],
    )


def binomial_interval(share: float, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share seen in `count` balls."""
    z = 1.96
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return max(0.0, middle - half), min(1.0, middle + half)


def _spread(spread: SeedSpread, digits: int) -> str:
    if spread.count == 0:
        return "-"
    if spread.count == 1:
        return f"{spread.mean:.{digits}f}"
    return f"{spread.mean:.{digits}f} ± {spread.std:.{digits}f} [{spread.low:.{digits}f}, {spread.high:.{digits}f}]"
