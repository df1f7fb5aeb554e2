"""The last evaluation of each seed of a run, and their mean with its 95 % interval, in figures and in words."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from app import theme
from core.learning.runs.summary import SeedSpread, spread_of

LISTED_SEEDS: Final = 20
Evaluations = tuple[dict[str, object], ...]
CELL: Final = "text-align:right;font-weight:400;padding:0 3px;white-space:nowrap"


@dataclass(frozen=True, slots=True)
class SeedEvaluation:
    """A seed's policy on the fixed balls when it was evaluated last."""

    seed: int
    episode: int
    """After so many balls."""
    speed_mps: float
    returned: float
    """%."""
    error_mm: float


@dataclass(frozen=True, slots=True)
class SeedResults:
    """Of a run with several seeds."""

    seeds: tuple[SeedEvaluation, ...]
    returned: SeedSpread
    """%, over the seeds that are `counted`; Student's t."""
    error_mm: SeedSpread
    counted: int
    """All seeds of a finished run; before its end those that have come farthest, and equally far."""


def seed_results(evaluations: dict[int, Evaluations], *, finished: bool) -> SeedResults | None:
    """The seeds of a run side by side; None for one seed, or before the first evaluation."""
    last = [_result(seed, lines[-1]) for seed, lines in sorted(evaluations.items()) if lines]
    if len(evaluations) < 2 or not last:
        return None
    farthest = max(last, key=lambda result: result.episode)
    alike = [one for one in last if finished or (one.episode, one.speed_mps) == (farthest.episode, farthest.speed_mps)]
    return SeedResults(
        tuple(last),
        spread_of([one.returned for one in alike]),
        spread_of([one.error_mm for one in alike]),
        len(alike),
    )


def seed_results_html(results: SeedResults | None) -> str:
    """A row for each seed, and one for their mean; empty for a run with one seed."""
    if results is None:
        return ""
    titles = "".join(f"<th style='{CELL}'>{title}</th>" for title in ("seed", "after", "returned", "error"))
    rows = [
        _row(str(one.seed), _after(one), _percent(one.returned), _mm(one.error_mm))
        for one in results.seeds[-LISTED_SEEDS:]
    ]
    returned, error = results.returned, results.error_mm
    mean = _row(
        f"<b>mean of {results.counted}</b>", "", f"<b>{_percent(returned.mean)}</b>", f"<b>{_mm(error.mean)}</b>"
    )
    ends = ""
    if max(returned.count, error.count) > 1:
        ends = _row("95 % interval", "", _ends(returned, 1, 100.0), _ends(error, 0, math.inf))
    more = len(results.seeds) - LISTED_SEEDS
    note = f"and {more} seeds before; " if more > 0 else ""
    return (
        f"<div style='font-size:11.5px;padding:2px 12px'><table style='width:100%'><tr>{titles}</tr>"
        f"{''.join(rows)}{mean}{ends}</table><span style='color:{theme.MUTED}'>{note}the last checkpoint's policy on "
        f"the fixed balls; interval of the mean, Student's t over seeds</span></div>"
    )


def _row(*cells: str) -> str:
    return "<tr>" + "".join(f"<td style='{CELL}'>{cell}</td>" for cell in cells) + "</tr>"


def _after(one: SeedEvaluation) -> str:
    return f"{one.episode}, {one.speed_mps:g} m/s" if math.isfinite(one.speed_mps) else str(one.episode)


def _ends(spread: SeedSpread, digits: int, highest: float) -> str:
    """The interval as far as it means anything: no share is above 100 %, no distance below 0."""
    if spread.count < 2:
        return "-"
    return f"{max(0.0, spread.low):.{digits}f} to {min(highest, spread.high):.{digits}f}"


def _percent(value: float) -> str:
    return f"{value:.1f} %" if math.isfinite(value) else "-"


def _mm(value: float) -> str:
    return f"{value:.0f} mm" if math.isfinite(value) else "-"


def _result(seed: int, line: dict[str, object]) -> SeedEvaluation:
    episode = line.get("episode")
    return SeedEvaluation(
        seed,
        episode if isinstance(episode, int) else 0,
        _number(line.get("speed_mps")),
        100.0 * _number(line.get("returned")),
        _number(line.get("error_mm")),
    )


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) and abs(value) < 1e12 else math.nan
