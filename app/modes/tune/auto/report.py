"""What `rallyscope tune --json` says, as a value, and as the table that Tune shows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from app import theme
from app.formatting.file_text import html_text
from core.text.json_text import parse_json
from core.tuning.split_score import Figures

TITLES: Final = ("windows", "config", "precision", "recall", "median error", "objective")
CELL: Final = "padding-right:14px;white-space:nowrap"
BAR_PX: Final = 60


@dataclass(frozen=True, slots=True)
class SidesFigures:
    """Figures of one config on the training and the held-out side of the split."""

    tuned: Figures
    held_out: Figures


@dataclass(frozen=True, slots=True)
class TuningReport:
    """What came of a search."""

    start: SidesFigures
    best: SidesFigures
    best_trial: int
    """0 if nothing was better than the config to start from."""
    trials: int
    better_held_out: bool
    changed: Mapping[str, tuple[object, object]]
    """Before and after, by the threshold's name."""
    importance: Mapping[str, float]
    """Share of each threshold, the largest first; empty if nothing can be said."""


def read_report(line: str) -> TuningReport:
    """From the line that the verb prints.

    Raises:
        ValueError: if it is none.
    """
    said = parse_json(line)
    if not isinstance(said, dict) or "importance" not in said:
        raise ValueError(f"not a report: {line[:80]}")
    return TuningReport(
        start=_sides(said["start"]),
        best=_sides(said["best"]),
        best_trial=said["best_trial"],
        trials=said["trials"],
        better_held_out=said["better_held_out"],
        changed={name: (before, after) for name, (before, after) in said["changed"].items()},
        importance=said["importance"],
    )


def report_html(title: str, report: TuningReport) -> str:
    """Both sides of the split beside each other, whether it holds, and what was changed."""
    start, best = report.start, report.best
    rows = [
        _row("tuned on", "A", start.tuned),
        _row("", "B", best.tuned),
        _row("held out", "A", start.held_out),
        _row("", "B", best.held_out),
    ]
    sides = f"<table>{_head(TITLES)}{''.join(rows)}</table>"
    thresholds = f"<table>{_head(('threshold', 'A', 'B', 'importance'))}{_thresholds(report)}</table>"
    head = f"{html_text(title)}, {report.trials} trials. {_verdict(report)}"
    return (
        f"<div style='font-size:12.5px;padding:4px 12px'>{head}"
        f"<div style='display:flex;gap:24px;align-items:flex-start'>{sides}{thresholds}</div></div>"
    )


def _sides(said: Mapping[str, Mapping[str, Any]]) -> SidesFigures:
    return SidesFigures(_figures(said["tuned"]), _figures(said["held_out"]))


def _figures(said: Mapping[str, Any]) -> Figures:
    ratios = {name: math.nan if value is None else float(value) for name, value in said.items() if name != "balls"}
    return Figures(**ratios, balls=int(said["balls"]))


def _verdict(report: TuningReport) -> str:
    start, best = report.start.held_out.objective, report.best.held_out.objective
    if report.best_trial == 0:
        return f"<span style='color:{theme.MUTED}'>Nothing better was found: B is A.</span>"
    if report.better_held_out:
        return f"<span style='color:{theme.GOOD}'>B is better on the held-out windows, too.</span>"
    text = f"B is not better on the held-out windows ({start:.3f} before, {best:.3f} now): it fits the tuned ones only."
    return f"<span style='color:{theme.BAD}'>{text}</span>"


def _thresholds(report: TuningReport) -> str:
    names = sorted(report.importance or report.changed, key=lambda name: name not in report.changed)  # a stable sort
    rows = []
    for name in names:
        before, after = report.changed.get(name, ("", "as it was"))
        share = report.importance.get(name)
        bar = "" if share is None else f"{_bar(share)} {100 * share:.0f} %"
        rows.append(_cells(html_text(name), html_text(_said(before)), html_text(_said(after)), bar))
    return "".join(rows)


def _bar(share: float) -> str:
    width = max(1, round(BAR_PX * share))
    return f"<span style='display:inline-block;height:8px;width:{width}px;background:rgb{theme.BRAND_RGB}'></span>"


def _row(side: str, config: str, figures: Figures) -> str:
    found = "-" if math.isnan(figures.median_error_px) else f"{figures.median_error_px:.2f} px"
    return _cells(side, config, f"{figures.precision:.3f}", f"{figures.recall:.3f}", found, f"{figures.objective:.3f}")


def _head(titles: tuple[str, ...]) -> str:
    cells = "".join(f"<th style='text-align:left;font-weight:500;{CELL}'>{title}</th>" for title in titles)
    return f"<tr>{cells}</tr>"


def _cells(*cells: str) -> str:
    return "<tr>" + "".join(f"<td style='{CELL}'>{cell}</td>" for cell in cells) + "</tr>"


def _said(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
