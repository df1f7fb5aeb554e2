"""Curves of a run over its episodes, and the last evaluation of each seed with their mean."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app import theme
from app.formatting import table_row
from app.shared.training_records import Metrics, number
from core.learning.runs.summary import SeedSpread, spread_of
from core.physics.episode import Case
from core.text import counted

Array = NDArray[np.float64]
WINDOW: Final = 25
"""Balls averaged in a point of a smoothed curve; fewer at the beginning, `FEWEST` at least."""
FEWEST: Final = 5
"""Fewest balls of a point: one lucky ball is no return rate."""
MAX_POINTS: Final = 1000
MAX_VALUES: Final = 10_000
"""Most points of all seeds' lines of a chart: they are sent anew twice a second."""
MAX_BORDERS: Final = 40
"""Most stages whose beginning is drawn; the last ones are."""
WIDE_SHARE: Final = 0.12
NARROW_SHARE: Final = 0.04
"""Share of a chart's width that a speed needs, with and without its unit."""
CURVES: Final[tuple[str, ...]] = ("returned", "error_mm", "reward", "noise", "w1", "w2")


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """The curves of one seed; each (N,) has a value per episode."""

    values: dict[str, Array]
    """Values of each curve, by the names in CURVES."""
    evaluated_at: Array
    """(E,) episodes after which the policy played the fixed balls."""
    evaluated: dict[str, Array]
    """`returned` (%) and `error_mm` of these evaluations, (E,)."""

    def __len__(self) -> int:
        return len(self.values["reward"])


def curves_of(metrics: Metrics) -> Curves:
    """The smoothed curves of a seed."""
    c = metrics.columns
    returned = 100.0 * (c["case"] == Case.RETURNED)
    values = {
        "returned": rolling_mean(returned, WINDOW),
        "error_mm": rolling_mean(c["error_mm"], WINDOW),
        "reward": rolling_mean(c["reward"], WINDOW),
        "noise": c["noise"],
        "w1": c["w1"],
        "w2": c["w2"],
    }
    lines = metrics.evaluations
    evaluated = {
        "returned": np.array([100.0 * number(line.get("returned")) for line in lines]),
        "error_mm": np.array([number(line.get("error_mm")) for line in lines]),
    }
    return Curves(values, np.array([number(line.get("episode")) for line in lines]), evaluated)


def rolling_mean(values: Array, window: int) -> Array:
    """(N,) mean of the known ones among the last `window` values (N,); NaN before the FEWEST-th, or if none is."""
    known = np.isfinite(values)
    total = np.concatenate([[0.0], np.cumsum(np.where(known, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(known)])
    end = np.arange(1, len(values) + 1)
    start = np.maximum(end - window, 0)
    counts = count[end] - count[start]
    enough = (counts > 0) & (end >= min(FEWEST, window))
    return np.where(enough, (total[end] - total[start]) / np.maximum(counts, 1), np.nan)


def shared_axis(longest: int, curves: int = 1) -> Array:
    """Episodes, counted from 1, at which so many curves are drawn: all, or evenly spaced ones up to the last."""
    points = min(MAX_POINTS, MAX_VALUES // max(1, curves))
    if longest <= points:
        return np.arange(1, longest + 1, dtype=np.float64)
    step = math.ceil(longest / points)
    axis = np.arange(longest, 0, -step, dtype=np.float64)[::-1]
    return np.ascontiguousarray(axis)


def on_axis(values: Array, axis: Array) -> Array:
    """(A,) values of a curve (N,) at the episodes of an axis; NaN beyond its end."""
    index = axis.astype(np.intp) - 1
    inside = index < len(values)
    return (
        np.where(inside, values[np.minimum(index, len(values) - 1)], np.nan)
        if len(values)
        else np.full(len(axis), np.nan)
    )


def stage_borders(speeds_mps: Array) -> Array:
    """Episodes, counted from 1, with which another stage of the curriculum began: (B,), from each ball's speed (N,)."""
    return (np.flatnonzero(np.diff(speeds_mps) != 0).astype(np.float64) + 2.0)[-MAX_BORDERS:]


def stages_of(speeds_mps: Array) -> tuple[tuple[float, float], ...]:
    """Episode with which each stage of the curriculum began, 0 for the first, and its speed, from the balls' (N,)."""
    if not len(speeds_mps):
        return ()
    borders = stage_borders(speeds_mps)
    return ((0.0, float(speeds_mps[0])), *((float(at), float(speeds_mps[int(at) - 1])) for at in borders))


def stage_labels(stages: tuple[tuple[float, float], ...], end: int) -> tuple[str, ...]:
    """Speed of each stage as text, shorter or none where the stage is a small part of a chart up to the ball `end`."""
    ends = [*(start for start, _ in stages[1:]), float(end)]
    shares = [(after - start) / max(end, 1) for (start, _), after in zip(stages, ends, strict=False)]
    return tuple(
        f"{speed:g} m/s" if share >= WIDE_SHARE else f"{speed:g}" if share >= NARROW_SHARE else ""
        for (_, speed), share in zip(stages, shares, strict=True)
    )


def with_borders(axis: Array, borders: Array) -> Array:
    """The axis with each border twice more: a chart draws an upright line between two points at one place."""
    return np.sort(np.concatenate([axis, borders, borders]))


def border_lines(axis: Array, borders: Array, low: float, high: float) -> Array:
    """(A,) curve of upright lines from `low` to `high` at the borders of an axis of `with_borders`; NaN elsewhere.

    Args:
        axis: (A,) x values, ascending.
        borders: (B,) x values of the lines.
        low: lower end of each.
        high: upper end.
    """
    line = np.full(len(axis), np.nan)
    first = np.searchsorted(axis, borders)
    line[first], line[first + 1] = low, high
    return line


def points_on_axis(at: Array, values: Array, axis: Array) -> Array:
    """(A,) single points at episodes `at` (E,), each at the nearest place of the axis; NaN elsewhere."""
    placed = np.full(len(axis), np.nan)
    if len(axis) and len(at):
        right = np.clip(np.searchsorted(axis, at), 0, len(axis) - 1)
        left = np.maximum(right - 1, 0)
        nearest = np.where(np.abs(axis[left] - at) < np.abs(axis[right] - at), left, right)
        placed[nearest] = values
    return placed


def mean_curve(curves: list[Array]) -> Array:
    """(N,) mean over seeds, as far as the longest goes."""
    if len(curves) == 1:
        return curves[0]
    table = _table(curves)
    known = np.isfinite(table)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, table, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def interval_curves(curves: list[Array]) -> tuple[Array, Array]:
    """(N,) lower and (N,) upper end of the mean's 95 % interval over seeds, Student's t; NaN for fewer than two."""
    from scipy.special import stdtrit  # Student's t; loaded late, because the app's page waits for this module

    table = _table(curves)
    known = np.isfinite(table)
    count = known.sum(axis=0)
    mean = np.where(known, table, 0.0).sum(axis=0) / np.maximum(count, 1)
    squares = np.where(known, table - mean, 0.0) ** 2
    std = np.sqrt(squares.sum(axis=0) / np.maximum(count - 1, 1))
    half = stdtrit(np.maximum(count - 1, 1), 0.975) * std / np.sqrt(np.maximum(count, 1))
    half = np.where(count > 1, half, np.nan)
    return mean - half, mean + half


def _table(curves: list[Array]) -> Array:
    """(S, N) as long as the longest; NaN beyond the end of a shorter one."""
    table = np.full((len(curves), max(map(len, curves), default=0)), np.nan)
    for row, curve in zip(table, curves, strict=True):
        row[: len(curve)] = curve
    return table


LISTED_SEEDS: Final = 20
Evaluations = tuple[dict[str, object], ...]
CELL: Final = "text-align:right;font-weight:400;padding:0 3px;white-space:nowrap"


@dataclass(frozen=True, slots=True)
class SeedEvaluation:
    """Last evaluation of a seed's policy on the fixed balls."""

    seed: int
    episode: int
    """Number of balls before it."""
    speed_mps: float
    returned: float
    """Share returned, %."""
    error_mm: float


@dataclass(frozen=True, slots=True)
class SeedResults:
    """Results of a run with several seeds."""

    seeds: tuple[SeedEvaluation, ...]
    returned: SeedSpread
    """Share returned, %, over the `counted` seeds, with Student's t interval."""
    error_mm: SeedSpread
    counted: int
    """All seeds of a finished run; before its end those that have come farthest, and equally far."""


def seed_results(evaluations: dict[int, Evaluations], *, finished: bool) -> SeedResults | None:
    """Results of all seeds of a run; None for one seed, or before the first evaluation."""
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
    """HTML with a row for each seed, and one for their mean; empty for a run with one seed."""
    if results is None:
        return ""
    titles = table_row(("seed", "after", "returned", "error"), CELL, tag="th")
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
    note = f"and {counted(more, 'seed')} before; " if more > 0 else ""
    return (
        f"<div style='font-size:11.5px;padding:2px 12px'><table style='width:100%'>{titles}"
        f"{''.join(rows)}{mean}{ends}</table><span style='color:{theme.MUTED}'>{note}the last checkpoint's policy on "
        f"the fixed balls; interval of the mean, Student's t over seeds</span></div>"
    )


def _row(*cells: str) -> str:
    return table_row(cells, CELL)


def _after(one: SeedEvaluation) -> str:
    return f"{one.episode}, {one.speed_mps:g} m/s" if math.isfinite(one.speed_mps) else str(one.episode)


def _ends(spread: SeedSpread, digits: int, highest: float) -> str:
    """Interval clipped to possible values: no share above 100 %, no distance below 0."""
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
        number(line.get("speed_mps")),
        100.0 * number(line.get("returned")),
        number(line.get("error_mm")),
    )
