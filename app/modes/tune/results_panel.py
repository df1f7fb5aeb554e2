"""Below the picture in Tune: the candidates of the window, and the scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import viser

from app import theme
from app.formatting import html_text, table_row
from app.modes.tune.label_score import LabelScore, label_score_html
from app.modes.tune.settings import setting_anchor, stage_counts_html
from app.panels.keys import place_below_pictures
from app.pictures.palette import palette
from app.views.stage_picture import KIND_INK, cluster_colour_index
from app.widgets import when_changed, when_clicked
from core.detection import Detection, RefinedDetection
from core.detection.method_trace import CandidateRow, MethodTrace, Residuals
from core.detection.reasons import FIXED, Reason, ReasonCount
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
        self._labels = gui.add_html("", visible=False)
        self._table = gui.add_html(stage_counts_html("No score yet"))
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._start = gui.add_button("Score this config on the whole recording", icon=viser.Icon.TARGET, color="teal")
        self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)
        self._delay = gui.add_number(
            "Extra latency [ms]",
            0.0,
            min=0.0,
            max=MAX_DELAY_MS,
            step=0.5,
            hint="Time from cable, network and robot, added to the computing time in the Live columns",
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
        *("Live: age of answer", "recall", "error", "error extrapolated"),
    )
    head = table_row(titles, "text-align:left;font-weight:500", tag="th")
    return (
        "<div style='font-size:12.5px;padding:4px 12px'>"
        f"<table style='width:100%'>{head}{''.join(rows)}</table>"
        "Found: within 8 px of the truth at the time of the answer. Live: the newest answer that a robot would have; "
        "its median age, its median error as it is, and extrapolated with the ball's velocity.</div>"
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
"""Largest distance of a click from a candidate's nearest event that selects it."""
TIGHT: Final = "font-size:12.5px;line-height:15px;padding:0 12px;margin-top:-6px"
CELL: Final = "padding:0"
"""CSS of a table cell: four clusters fit into a window of 1280x720 without scrolling."""


class CandidatesTable:
    """A table of the candidates of a window, the ball first; without a ball the reasons come before it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._nothing = gui.add_html("", visible=False)
        self._table = gui.add_html(stage_counts_html("Computing the first window ..."))

    def show(
        self,
        answers: tuple[tuple[str, WindowAnswer], ...],
        seconds: float,
        picked_px: tuple[float, float] | None = None,
    ) -> None:
        """Show the candidates of each answer, under a title if there are several; a clicked one comes first."""
        several = len(answers) > 1
        tables = (answer_html(title if several else "", answer, picked_px) for title, answer in answers)
        self._table.content = "".join(tables) + stage_counts_html(f"picture made in {seconds * 1e3:.0f} ms")

    def show_verdicts(self, answers: tuple[tuple[str, WindowAnswer], ...], seconds: float) -> None:
        """Show only what each of several methods answers."""
        lines = "".join(verdict_html(title, answer) for title, answer in answers)
        self._table.content = lines + stage_counts_html(f"picture made in {seconds * 1e3:.0f} ms")

    def show_nothing_found(self, content: str) -> None:
        """Show why nothing is found in the whole recording; nothing if empty."""
        self._nothing.content = content
        self._nothing.visible = bool(content)


def answer_html(title: str, answer: WindowAnswer, picked_px: tuple[float, float] | None = None) -> str:
    """HTML of one answer with its candidates."""
    trace = answer.trace
    if trace is None or not trace.titles:
        return verdict_html(title, answer)
    return candidates_html(title, trace, candidate_at(trace, picked_px), facts=answer_facts(answer))


def verdict_html(title: str, answer: WindowAnswer) -> str:
    """HTML of one answer without candidates."""
    label = f"{html_text(title)}: " if title else ""
    window = answer.window
    length_ms = (window.end_us - window.start_us) / 1e3
    lines = [f"{label}{_verdict(answer.detection)} &middot; {len(window.events)} events in {length_ms:g} ms"]
    reasons = () if answer.trace is None else answer.trace.reasons
    lines += [reasons_html(reasons)] if reasons else []
    lines += answer_facts(answer)
    before = answer.lead_in_windows
    used = f"{before} earlier windows used" if before else "No earlier windows used (start of the recording)"
    lines.append(f"{answer.method}: {used}")
    return "<div style='font-size:12.5px;padding:4px 12px'>" + "<br>".join(lines) + "</div>"


def answer_facts(answer: WindowAnswer) -> list[str]:
    """Phrases about the ball: when it is valid, how it moves, how sure it is."""
    ball, facts = answer.detection, []
    if ball is not None:
        facts.append(f"position at {ball.t_us / 1e3:.3f} ms")
    if isinstance(ball, RefinedDetection):
        sigma_px = float(ball.centre_covariance_px2.trace()) ** 0.5
        facts.append(f"moves ({ball.vu_px_per_ms:+.2f}, {ball.vv_px_per_ms:+.2f}) px/ms")
        facts.append(f"estimated error {sigma_px:.2f} px, {ball.fit.points:.0f} edge points")
    return facts


def _verdict(found: Detection | None) -> str:
    if found is None:
        return f"<b style='color:{theme.BAD}'>no ball</b>"
    where = f"({found.u_px:.1f}, {found.v_px:.1f})"
    return f"<b style='color:{theme.GOOD}'>ball at {where}, radius {found.r_px:.1f} px</b>"


def candidate_at(trace: MethodTrace, point_px: tuple[float, float] | None) -> int | None:
    """Label of the candidate with the event nearest to a point, within PICK_PX; None otherwise."""
    places = [one for one in trace.candidates if len(one.x_px)]
    if point_px is None or not places:
        return None
    nearest_px, label = min(
        (float(np.hypot(one.x_px - point_px[0], one.y_px - point_px[1]).min()), one.label) for one in places
    )
    return label if nearest_px <= PICK_PX else None


def candidates_html(name: str, trace: MethodTrace, picked: int | None = None, *, facts: Sequence[str] = ()) -> str:
    """HTML of the candidates of one window; the selected one comes first, highlighted, with its residuals."""
    verdict = _verdict(trace.detection)
    ordered = sorted(trace.candidates, key=lambda one: (one.label != picked, bool(one.reasons), -one.order))
    titles = ("", trace.noun, *trace.titles, "verdict")
    head = table_row(titles, f"{CELL};text-align:left;font-weight:500;color:{theme.MUTED}", tag="th")
    rows = "".join(_candidate_row(candidate, candidate.label == picked) for candidate in ordered[:LISTED])
    more = f"<div>and {len(ordered) - LISTED} more</div>" if len(ordered) > LISTED else ""
    label = f"{html_text(name)}: " if name else ""
    plural = "es" if trace.noun.endswith("x") else "s"
    count = f"{len(ordered)} {trace.noun}" if len(ordered) == 1 else f"{len(ordered)} {trace.noun}{plural}"
    why = f": {reasons_html(trace.reasons)}" if trace.reasons and not ordered else ""
    summary = " &middot; ".join([f"{label}{verdict}{why}", *facts, trace.where, count])
    shown = next((one for one in ordered if one.residuals is not None), None)
    plot = residuals_html(trace.noun, shown.label, shown.residuals) if shown is not None and shown.residuals else ""
    table = f"<table style='width:100%;border-spacing:0'>{head}{rows}</table>"
    return f"<div style='{TIGHT}'>{summary}{table}{more}{plot}</div>"


def reasons_html(reasons: Sequence[Reason | ReasonCount]) -> str:
    """Links to the sliders of the limits that failed; those without a slider say that they are fixed."""
    return "; ".join(map(_reason_html, reasons))


def _reason_html(reason: Reason | ReasonCount) -> str:
    if reason.setting is None:
        return f"<span style='color:{theme.BAD}'>{html_text(reason.text)}</span> ({FIXED})"
    return (
        f"<a href='#{setting_anchor(reason.setting)}' title='go to its slider, {html_text(reason.setting)}' "
        f"style='color:{theme.BAD}'>{html_text(reason.text)}</a>"
    )


def _candidate_row(candidate: CandidateRow, picked: bool) -> str:
    red, green, blue = palette("orange / blue")[cluster_colour_index(candidate.label)]
    swatch = f"<span style='color:rgb({red},{green},{blue})'>&#9632;</span>"
    verdict = (
        reasons_html(candidate.reasons)
        if candidate.reasons
        else f"<span style='color:{theme.GOOD}'>{html_text(candidate.verdict)}</span>"
    )
    cells = (swatch, candidate.label, *map(html_text, candidate.figures), verdict)
    return table_row(cells, CELL, row_style="background:rgba(255,140,40,0.25)" if picked else "")


PLOT_PX: Final = (420, 74)
"""Width and height of the plot of residuals."""
PLOT_SPAN_PX: Final = 2.5
"""Residual at its upper edge: the width of the band of edge points."""
PLOTTED: Final = 400
"""Most points in it."""


def residuals_html(noun: str, label: int, residuals: Residuals) -> str:
    """A small plot of the edge points' distances from the circle over their direction, and the limit of their rms."""
    width, height = PLOT_PX
    every = max(1, len(residuals.angle_rad) // PLOTTED)
    x = (residuals.angle_rad[::every] / (2 * np.pi) + 0.5) * width
    y = (0.5 - np.clip(residuals.residual_px[::every] / PLOT_SPAN_PX, -1, 1) / 2) * height
    inks = {kind: palette("orange / blue")[ink].tolist() for kind, ink in KIND_INK.items()}
    dots = "".join(
        f"<circle cx='{px:.0f}' cy='{py:.1f}' r='1.3' fill='rgb{tuple(inks[kind])}'/>"
        for px, py, kind in zip(x.tolist(), y.tolist(), residuals.kind[::every].tolist(), strict=True)
    )
    limits = "".join(
        f"<line x1='0' x2='{width}' y1='{at:.1f}' y2='{at:.1f}' stroke='{theme.MUTED}' stroke-dasharray='{dash}'/>"
        for at, dash in (
            (height / 2, ""),
            ((0.5 - residuals.limit_px / PLOT_SPAN_PX / 2) * height, "3 3"),
            ((0.5 + residuals.limit_px / PLOT_SPAN_PX / 2) * height, "3 3"),
        )
    )
    text = (
        f"residuals of {noun} {label} [±{PLOT_SPAN_PX:g} px] over the direction from its motion, -180° to 180°; "
        "green leading, blue trailing edge, red outliers; dashed: the limit of their rms"
    )
    return (
        f"<div style='color:{theme.MUTED}'>{text}</div><svg width='{width}' height='{height}' role='img' "
        f"aria-label='residuals'>{limits}{dots}</svg>"
    )


class ResultsPanel:
    """A floating panel of one browser."""

    def __init__(self, gui: viser.GuiApi, start_score: Callable[[], None], cancel_score: Callable[[], None]) -> None:
        self.panel = gui.add_panel(visible=False)
        with self.panel.add_tab("Candidates", viser.Icon.LIST_DETAILS):
            self.candidates = CandidatesTable(gui)
        with self.panel.add_tab("Score", viser.Icon.TARGET):
            self.score = ScorePanel(gui, start_score, cancel_score)
        with self.panel.add_tab("Auto-tune", viser.Icon.WAND):
            self._tuned = gui.add_html(stage_counts_html("No result yet. Start Auto-tune in the panel on the right"))
        place_below_pictures(gui, self.panel)

    def show_tuned(self, content: str) -> None:
        """Show the result of automatic tuning."""
        self._tuned.content = content
