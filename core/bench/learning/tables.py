"""Numbers over seeds as text: mean, standard deviation, 95 % interval, paired differences, and a row per training."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from core.bench.learning.runs import Results, SeedResult, values_at, values_at_end
from core.learning.runs.summary import SeedSpread, spread_of
from core.text.markdown_table import markdown_table

Column = Callable[[Sequence[SeedResult]], str]
"""What a table says of a training."""


def table_of_trainings(
    results: Results, title: str, trainings: Mapping[str, str], columns: Mapping[str, Column]
) -> str:
    """A row per training, by the words for it: how many seeds there are, and every column."""
    rows = [[words, str(len(results[name])), *(say(results[name]) for say in columns.values())]
            for words, name in trainings.items()]  # fmt: skip
    return markdown_table((title, "seeds", *columns), rows)


def at(episode: int, what: str) -> Column:
    """The figure after so many episodes; what: returned, error_mm or error_returned_mm."""
    return lambda found: shown(what, values_at(found, episode, what))


def at_end(speed_mps: float, what: str) -> Column:
    """The figure at the end of the stage of a speed."""
    return lambda found: shown(what, values_at_end(found, speed_mps, what))


def five_best(speed_mps: float) -> Column:
    """The mean of the five lowest errors of each seed."""
    return lambda found: shown("error_mm", [result.five_best_mm(speed_mps) for result in found])


def shown(what: str, values: Sequence[float]) -> str:
    """Shares 0..1 as percent, 98.4 ± 1.2 [97.8, 99.0]; errors in mm, 148 ± 31 [133, 162].

    The interval ends where percentages do, and no distance is negative; there is no interval of one.
    """
    scale, most = (100, 100.0) if what == "returned" else (1, math.inf)
    spread = spread_of([scale * value for value in values])
    digits = 0 if what != "returned" and spread.mean >= 30 else 1
    if spread.count < 2:
        return f"{spread.mean:.{digits}f}" if spread.count else "-"
    low, high = max(spread.low, 0.0), min(spread.high, most)
    return f"{spread.mean:.{digits}f} ± {spread.std:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def paired(a: Sequence[SeedResult], b: Sequence[SeedResult], episode: int, what: str) -> str:
    """Mean difference a - b over the seeds that both have (same balls), and whether its interval holds zero."""
    spread = paired_spread(a, b, episode, what)
    if spread.count < 2:
        return "-"
    verdict = "no difference shown" if spread.low <= 0 <= spread.high else "differs"
    return f"{difference(spread)}, {verdict}"


def difference(spread: SeedSpread) -> str:
    """A difference with its interval."""
    return f"{spread.mean:+.1f} [{spread.low:+.1f}, {spread.high:+.1f}]"


def paired_spread(a: Sequence[SeedResult], b: Sequence[SeedResult], episode: int, what: str) -> SeedSpread:
    """Differences a - b over the seeds that both have, in percentage points or millimetres."""
    pairs = [(one.at(episode), other.at(episode)) for one in a for other in b if one.seed == other.seed]
    scale = 100 if what == "returned" else 1
    return spread_of([scale * (getattr(x, what) - getattr(y, what)) for x, y in pairs if x and y])
