"""Numbers over seeds as text: mean, standard deviation, 95 % interval, paired differences, and a row per training."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from benchmarks.learning.runs import Results, SeedResult, values_at, values_at_end
from core.errors import ConfigError
from core.learning.runs.summary import spread_of
from core.metrics.paired import pair_by_seed, paired_difference
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
    """The figure after so many episodes; what: returned, error_mm, error_returned_mm or missed."""
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
    is_share = what in ("returned", "missed")
    scale, most = (100, 100.0) if is_share else (1, math.inf)
    spread = spread_of([scale * value for value in values])
    digits = 0 if not is_share and spread.mean >= 30 else 1
    if spread.count < 2:
        return f"{spread.mean:.{digits}f}" if spread.count else "-"
    low, high = max(spread.low, 0.0), min(spread.high, most)
    return f"{spread.mean:.{digits}f} ± {spread.std:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def paired(a: Sequence[SeedResult], b: Sequence[SeedResult], episode: int, what: str) -> str:
    """Mean difference a - b with its 95 % interval, in percentage points or millimetres; whether a claim holds is said
    where all claims are. Where the seeds of the two are not the same, that, and no number.
    """
    scale = 100 if what == "returned" else 1
    sides = [{r.seed: scale * getattr(e, what) for r in found if (e := r.at(episode)) is not None} for found in (a, b)]
    try:
        _, ours, theirs = pair_by_seed(*sides, where=f"@{episode}")
    except ConfigError as error:
        return str(error)
    found = paired_difference(ours, theirs)
    return f"{found.estimate:+.1f} [{found.low:+.1f}, {found.high:+.1f}]" if found.count > 1 else "-"
