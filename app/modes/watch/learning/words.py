"""How learning in the live rally goes, as HTML and as the columns of a chart."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app import theme
from app.formatting.file_text import html_text
from app.modes.watch.learned_words import balls_text
from core.online_learning.progress import WINDOW, LearningProgress

Array = NDArray[np.float64]
SHOWN: Final = 300
"""Balls in the chart: the newest."""
RANGE_MM: Final = (1.0, 2000.0)
"""Of the chart, logarithmic; what is beyond it, or not known, stands at its edge."""
STYLE: Final = "font-size:12.5px;padding:2px 12px;line-height:1.45"


def reason_html(reason: str) -> str:
    """Why there is nothing to press."""
    return f"<div style='{STYLE};color:{theme.MUTED}'>{html_text(reason)}</div>"


def learning_html(progress: LearningProgress | None, *, on: bool) -> str:
    """A few lines; nothing before it began."""
    if progress is None:
        return ""
    lines = [f"<b>{balls_text(progress.learned)} learned from</b>, started from {html_text(progress.start)}"]
    if progress.balls:
        back, of = progress.returned_lately
        _, medians = progress.errors_mm()
        median = f"{medians[-1]:.0f} mm" if math.isfinite(medians[-1]) else "unknown"
        lines.append(f"last {of}: {back} returned, landing error {median} (median)")
        lines.append(f"all {len(progress.balls)}: {progress.returned} returned")
        if progress.balls[-1].random:
            lines.append("random strokes so far, to explore")
    if not on:
        lines.append("somebody else plays: nothing is learned now")
    if progress.problem:
        lines.append(f"a ball was not learned from: {html_text(progress.problem)}")
    return f"<div style='{STYLE}'>{'<br>'.join(lines)}</div>"


def chart_columns(progress: LearningProgress) -> tuple[Array, Array, Array]:
    """Number of each ball (from 1), its error and the running median, mm: (N,) each, within the chart's range."""
    errors, medians = progress.errors_mm()
    numbers = np.arange(1.0, len(errors) + 1)
    shown = slice(max(0, len(errors) - SHOWN), None)
    error, median = (np.clip(np.nan_to_num(one, nan=np.inf), *RANGE_MM)[shown] for one in (errors, medians))
    return numbers[shown], error, median


def chart_title_html() -> str:
    """What is drawn."""
    return (
        f"<div style='font-size:12px;padding:0 12px;color:{theme.MUTED}'>Landing error of each ball, mm, and the median"
        f" of the last {WINDOW}. At the top: it did not come down</div>"
    )
