"""The score of a config over a whole recording."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app.formatting.file_text import html_text
from app.modes.tune.label_score import LabelScore, label_score_html
from app.modes.tune.settings import stage_counts_html
from app.widgets import when_clicked
from core.metrics import Score

KEPT = 6
"""Scores shown below each other, newest first, so that changes can be compared."""


class ScorePanel:
    """Start, cancel, progress, and the last few scores."""

    def __init__(self, gui: viser.GuiApi, start: Callable[[], None], cancel: Callable[[], None]) -> None:
        self._gui = gui
        self._start = gui.add_button("Score this config on the whole recording", icon=viser.Icon.TARGET)
        self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._table = gui.add_html(stage_counts_html("not scored yet"))
        self._labels = gui.add_html("", visible=False)
        self._rows: list[str] = []
        when_clicked(self._start, start)
        when_clicked(self._cancel, cancel)

    def show_running(self, running: bool) -> None:
        """Swap the start button for progress and cancel."""
        self._start.visible = not running
        self._cancel.visible = running
        self._progress.visible = running
        self._progress.value = 0.0

    def show_progress(self, share: float) -> None:
        """Share of the recording that is done."""
        self._progress.value = 100.0 * share

    def show_window(self) -> None:
        """The score against labels that was shown last in a window of its own: it may be behind another tab here."""
        modal = self._gui.add_modal("The detector against your labels")
        with modal:
            self._gui.add_html(f"<div data-rallyscope='wide' style='overflow-x:auto'>{self._labels.content}</div>")
            when_clicked(self._gui.add_button("Close", icon=viser.Icon.CHECK), modal.close)

    def show_score(self, title: str, score: Score | LabelScore) -> None:
        """Add a row; a score against labels has a table and a picture of its own."""
        if isinstance(score, LabelScore):
            self._labels.content = label_score_html(title, score)
            self._labels.visible = True
            self._table.visible = bool(self._rows)
            return
        self._table.visible = True
        self._rows = [_row(title, score), *self._rows][:KEPT]
        self._table.content = score_html(self._rows)


def score_html(rows: list[str]) -> str:
    """The table of scores."""
    titles = ("", "precision", "recall", "mean error", "median error", "found", "missed", "false")
    head = "".join(f"<th style='text-align:left;font-weight:500'>{title}</th>" for title in titles)
    return (
        "<div style='font-size:12.5px;padding:4px 12px'>"
        f"<table style='width:100%'><tr>{head}</tr>{''.join(rows)}</table>"
        "a ball counts as found within 8 px of the truth at the estimate's own time</div>"
    )


def _row(title: str, score: Score) -> str:
    cells = (
        html_text(title),
        f"{score.precision:.3f}",
        f"{score.recall:.3f}",
        f"{score.mean_error_px:.2f} px",
        f"{score.median_error_px:.2f} px",
        score.found,
        score.missed,
        score.false,
    )
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
