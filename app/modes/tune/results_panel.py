"""Below the picture in Tune: the clusters of the window, and the scores."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import viser

from app import theme
from app.formatting import html_text, table_row
from app.modes.tune.label_score import LabelScore, label_score_html
from app.modes.tune.settings import stage_anchor, stage_counts_html
from app.panels.keys import float_below_pictures, place_below_pictures
from app.pictures.palette import palette
from app.views.stage_picture import cluster_colour_index
from app.widgets import when_changed, when_clicked
from core.detection import Candidate, Detection, PipelineTrace, RefinedDetection
from core.metrics import Score
from core.metrics.run import WindowAnswer
from core.metrics.streaming import StreamingScore, TimedRun

KEPT = 6
"""Scores shown below each other, newest first, so that changes can be compared."""
MAX_DELAY_MS: Final = 1000.0


class ScorePanel:
    """Start, cancel, progress, and the last few scores."""

    def __init__(self, gui: viser.GuiApi, start: Callable[[], None], cancel: Callable[[], None]) -> None:
        self._gui = gui
        self._start = gui.add_button("Score this config on the whole recording", icon=viser.Icon.TARGET)
        self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._table = gui.add_html(stage_counts_html("not scored yet"))
        self._labels = gui.add_html("", visible=False)
        self._delay = gui.add_number(
            "Delay of my system [ms]",
            0.0,
            min=0.0,
            max=MAX_DELAY_MS,
            step=0.5,
            hint="What an answer takes besides computing: cables, the network, the robot. For the score in time",
        )
        self._runs: list[tuple[str, TimedRun]] = []
        when_changed(self._delay, lambda _: self._show_runs())
        when_clicked(self._start, start)
        when_clicked(self._cancel, cancel)

    @property
    def added_us(self) -> int:
        """What an answer takes besides computing."""
        return round(1e3 * min(max(float(self._delay.value), 0.0), MAX_DELAY_MS))

    def show_running(self, running: bool) -> None:
        """Swap the start button for progress and cancel."""
        self._start.visible = not running
        self._cancel.visible = running
        self._progress.visible = running
        self._progress.value = 0.0

    def show_progress(self, share: float) -> None:
        """Show the share of the recording that is done."""
        self._progress.value = 100.0 * share

    def show_window(self) -> None:
        """Show the last score against labels in its own window; here it may be behind another tab."""
        modal = self._gui.add_modal("The detector against your labels")
        with modal:
            self._gui.add_html(f"<div data-rallyscope='wide' style='overflow-x:auto'>{self._labels.content}</div>")
            when_clicked(self._gui.add_button("Close", icon=viser.Icon.CHECK), modal.close)

    def show_score(self, title: str, score: TimedRun | LabelScore) -> None:
        """Add a row; a score against labels has a table and a picture of its own."""
        if isinstance(score, LabelScore):
            self._labels.content = label_score_html(title, score)
            self._labels.visible = True
            self._table.visible = bool(self._runs)
            return
        self._table.visible = True
        self._runs = [(title, score), *self._runs][:KEPT]
        self._show_runs()

    def _show_runs(self) -> None:
        if self._runs:
            rows = [_score_row(title, run.score(), run.in_time(self.added_us)) for title, run in self._runs]
            self._table.content = score_html(rows)


def score_html(rows: list[str]) -> str:
    """The table of scores."""
    titles = (
        *("", "precision", "recall", "mean error", "median error", "found", "missed", "false"),
        *("in time: age", "recall", "error held", "moved on"),
    )
    head = table_row(titles, "text-align:left;font-weight:500", tag="th")
    return (
        "<div style='font-size:12.5px;padding:4px 12px'>"
        f"<table style='width:100%'>{head}{''.join(rows)}</table>"
        "a ball counts as found within 8 px of the truth at the estimate's own time; in time: the newest answer "
        "that has arrived by then, its median age and error where it was and moved on by the ball's velocity</div>"
    )


def _score_row(title: str, score: Score, in_time: StreamingScore) -> str:
    cells = (
        html_text(title),
        f"{score.precision:.3f}",
        f"{score.recall:.3f}",
        f"{score.mean_error_px:.2f} px",
        f"{score.median_error_px:.2f} px",
        score.found,
        score.missed,
        score.false,
        f"{1e-3 * in_time.age_median_us:.2f} ms",
        f"{in_time.moved.recall:.3f}",
        f"{in_time.held_median_px:.2f} px",
        f"{in_time.moved_median_px:.2f} px",
    )
    return table_row(cells)


LISTED = 40
PICK_PX = 6.0
"""Largest distance of a click from a cluster's nearest event that selects it."""
TIGHT: Final = "font-size:12.5px;line-height:15px;padding:0 12px;margin-top:-6px"
CELL: Final = "padding:0"
"""CSS of a table cell: four clusters fit into a window of 1280x720 without scrolling."""


class CandidatesTable:
    """A table of the clusters, the ball first, then by size."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._table = gui.add_html(stage_counts_html("computing the first window"))

    def show(
        self,
        traces: tuple[tuple[str, PipelineTrace], ...],
        seconds: float,
        picked_px: tuple[float, float] | None = None,
    ) -> None:
        """Show the clusters of each config's trace; a clicked one comes first."""
        tables = (candidates_html(name if len(traces) > 1 else "", t, cluster_at(t, picked_px)) for name, t in traces)
        self._table.content = "".join(tables) + stage_counts_html(f"picture made in {seconds * 1e3:.0f} ms")

    def show_answers(self, answers: tuple[tuple[str, WindowAnswer], ...], seconds: float) -> None:
        """Show the answers of several methods, or of one method without stages with each config, with their titles."""
        self._table.content = "".join(answer_html(title if len(answers) > 1 else "", a) for title, a in answers) + (
            stage_counts_html(f"picture made in {seconds * 1e3:.0f} ms")
        )


def answer_html(title: str, answer: WindowAnswer) -> str:
    """HTML of one answer without clusters."""
    label = f"{html_text(title)}: " if title else ""
    window = answer.window
    length_ms = (window.end_us - window.start_us) / 1e3
    lines = [f"{label}{_verdict(answer.detection)} &middot; {len(window.events)} events in {length_ms:g} ms"]
    ball = answer.detection
    if ball is not None:
        lines.append(f"valid {(window.end_us - ball.t_us) / 1e3:.2f} ms before the end of the window")
    if isinstance(ball, RefinedDetection):
        sigma_px = float(ball.centre_covariance_px2.trace()) ** 0.5
        lines.append(f"moves ({ball.vu_px_per_ms:+.2f}, {ball.vv_px_per_ms:+.2f}) px/ms")
        lines.append(f"estimated error {sigma_px:.2f} px, {ball.fit.points:.0f} edge points")
    lines.append(f"{answer.method} has processed the {answer.lead_in_windows} windows before")
    return "<div style='font-size:12.5px;padding:4px 12px'>" + "<br>".join(lines) + "</div>"


def _verdict(found: Detection | None) -> str:
    if found is None:
        return f"<b style='color:{theme.BAD}'>no ball</b>"
    where = f"({found.u_px:.1f}, {found.v_px:.1f})"
    return f"<b style='color:{theme.GOOD}'>ball at {where}, radius {found.r_px:.1f} px</b>"


def cluster_at(trace: PipelineTrace, point_px: tuple[float, float] | None) -> int | None:
    """Label of the cluster with the event nearest to a point, within PICK_PX; None otherwise."""
    if point_px is None or not trace.candidates:
        return None
    nearest_px, label = min(
        (float(np.hypot(one.events.x_px - point_px[0], one.events.y_px - point_px[1]).min()), one.label)
        for one in trace.candidates
    )
    return label if nearest_px <= PICK_PX else None


def candidates_html(name: str, trace: PipelineTrace, picked: int | None = None) -> str:
    """HTML of one config's clusters; the selected one comes first, highlighted."""
    verdict = _verdict(trace.detection)
    where = "searched in the ROI" if trace.roi else "searched on the whole sensor"
    ordered = sorted(trace.candidates, key=lambda one: (one.label != picked, one.rejected is not None, -one.size))
    titles = ("", "cluster", "events", "leads", "circularity", "solidity", "radius [px]", "verdict")
    head = table_row(titles, f"{CELL};text-align:left;font-weight:500;color:{theme.MUTED}", tag="th")
    rows = "".join(_candidate_row(candidate, candidate.label == picked) for candidate in ordered[:LISTED])
    more = f"<div>and {len(ordered) - LISTED} smaller ones</div>" if len(ordered) > LISTED else ""
    label = f"Config {html_text(name)}: " if name else ""
    count = f"{len(ordered)} cluster" if len(ordered) == 1 else f"{len(ordered)} clusters"
    return (
        f"<div style='{TIGHT}'>{label}{verdict} &middot; {where} &middot; {count}"
        f"<table style='width:100%;border-spacing:0'>{head}{rows}</table>{more}</div>"
    )


def _candidate_row(candidate: Candidate, picked: bool) -> str:
    red, green, blue = palette("orange / blue")[cluster_colour_index(candidate.label)]
    swatch = f"<span style='color:rgb({red},{green},{blue})'>&#9632;</span>"
    shape, circle = candidate.shape, candidate.circle
    verdict = (
        f"<a href='#{stage_anchor(candidate.rejected_by)}' title='go to its sliders' "
        f"style='color:{theme.BAD}'>{html_text(candidate.rejected)}</a>"
        if candidate.rejected and candidate.rejected_by
        else f"<span style='color:{theme.GOOD}'>ball</span>"
    )
    cells = (
        swatch, candidate.label, candidate.size, "ON" if candidate.leading_on else "OFF",
        f"{shape.circularity:.2f}" if shape else "-", f"{shape.solidity:.2f}" if shape else "-",
        f"{circle.r_px:.1f}" if circle else "-", verdict,
    )  # fmt: skip
    return table_row(cells, CELL, row_style="background:rgba(255,140,40,0.25)" if picked else "")


class ResultsPanel:
    """A floating panel of one browser."""

    def __init__(self, gui: viser.GuiApi, start_score: Callable[[], None], cancel_score: Callable[[], None]) -> None:
        self.panel = gui.add_panel(visible=False)
        with self.panel.add_tab("Candidates", viser.Icon.LIST_DETAILS):
            self.candidates = CandidatesTable(gui)
        with self.panel.add_tab("Score", viser.Icon.TARGET):
            self.score = ScorePanel(gui, start_score, cancel_score)
        with self.panel.add_tab("Auto-tune", viser.Icon.WAND):
            self._tuned = gui.add_html(stage_counts_html("no tuning yet: open Auto-tune on the right"))
        place_below_pictures(gui, self.panel)
        self._taken_px = 0

    def make_room(self, width_px: int) -> None:
        """Leave this much of the window's width free at the left."""
        if width_px != self._taken_px:
            self._taken_px = width_px
            float_below_pictures(self.panel, narrower_px=width_px)

    def show_tuned(self, content: str) -> None:
        """Show the result of automatic tuning."""
        self._tuned.content = content
