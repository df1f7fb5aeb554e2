"""Below the picture in Tune: the candidates of the window, and the scores."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import viser

from app import theme
from app.formatting import html_text, table_row
from app.modes.tune.label_score import LabelScore, label_score_html
from app.modes.tune.residuals_plot import residuals_html
from app.modes.tune.run_score import RunScore, run_score_row, run_scores_html
from app.modes.tune.settings import setting_anchor, stage_counts_html
from app.panels.keys import place_below_pictures
from app.pictures.palette import palette
from app.views.requests import is_wrong
from app.views.stage_picture import cluster_colour_index
from app.widgets import bounded, when_changed, when_clicked
from core.detection import Detection, RefinedDetection
from core.detection.method_trace import CandidateRow, MethodTrace
from core.detection.reasons import FIXED, Reason, ReasonCount
from core.detection.window import EarlyEnds
from core.metrics.run import WindowAnswer

KEPT = 6
"""Scores shown below each other, newest first, so that changes can be compared."""
MAX_DELAY_MS: Final = 1000.0
MAX_EVENTS: Final = 1_000_000
MAX_MOTION_PX: Final = 100.0


@dataclass(frozen=True, slots=True)
class Timing:
    """When answers come."""

    added_us: int
    """What an answer takes besides computing."""
    ends: EarlyEnds
    """What ends windows early."""


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
        self._events = gui.add_number(
            "Window ends [events]",
            0,
            min=0,
            max=MAX_EVENTS,
            step=100,
            hint="A window ends after so many events; 0: never. Counts for Score, Compare over time and Auto-tune",
        )
        self._motion = gui.add_number(
            "Window ends [px]",
            0.0,
            min=0.0,
            max=MAX_MOTION_PX,
            step=0.5,
            hint="A window ends when the ball has moved so far; 0: never. Counts for the same three",
        )
        self._runs: list[tuple[str, RunScore]] = []
        when_changed(self._delay, lambda _: self._show_runs())
        when_clicked(self._start, start)
        when_clicked(self._cancel, cancel)

    @property
    def added_us(self) -> int:
        """What an answer takes besides computing."""
        return round(1e3 * bounded(self._delay.value, (0.0, MAX_DELAY_MS)))

    @property
    def timing(self) -> Timing:
        """What is chosen for scores, comparisons and searches."""
        events = round(bounded(self._events.value, (0.0, MAX_EVENTS)))
        motion_px = bounded(self._motion.value, (0.0, MAX_MOTION_PX))
        return Timing(self.added_us, EarlyEnds(events=events or None, motion_px=motion_px or None))

    def show_running(self, running: bool, title: str = "") -> None:
        """Swap the start button for progress and cancel; `title` names what is scored."""
        if not self._runs:
            self._table.content = stage_counts_html(html_text(f"Scoring {title}") if title else "No score yet")
        self._start.visible = not running
        self._cancel.visible = running
        self._progress.visible = running
        self._progress.value = 0.0

    def show_progress(self, share: float) -> None:
        """Show the share of the recording that is done."""
        self._progress.value = 100.0 * share

    def show_window(self, back: Callable[[], None]) -> None:
        """Show the last score against labels in its own window; `back`: go to where it was asked for."""
        modal = self._gui.add_modal("The detector against your labels")
        with modal:
            self._gui.add_html(f"<div data-rallyscope='wide' style='overflow-x:auto'>{self._labels.content}</div>")
            label = self._gui.add_button("Back to Label", icon=viser.Icon.ARROW_LEFT)
            stay = self._gui.add_button("Stay in Tune", icon=viser.Icon.CHECK)

        def go_back() -> None:
            modal.close()
            back()

        when_clicked(label, go_back)
        when_clicked(stay, modal.close)

    def show_score(self, title: str, score: RunScore | LabelScore) -> None:
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
            rows = [run_score_row(title, run, self.added_us) for title, run in self._runs]
            self._table.content = run_scores_html(rows)


LISTED = 40
PICK_PX = 6.0
"""Largest distance of a click from a candidate's nearest event that selects it."""
TIGHT: Final = "font-size:12.5px;line-height:15px;padding:0 12px;margin-top:-6px"
CELL: Final = "padding:0 10px 0 0;white-space:nowrap"
"""CSS of a table cell: no height is spent, so that four clusters fit into a window of 1280x720 without scrolling."""
PAIR_PX: Final = 400
"""Two answers stand side by side if each gets this width: below the first, the second would be out of sight."""
REASONS_PX: Final = 130
"""Width of a column of reasons, which would else wrap at each word."""
LONGEST_IN_COLUMN: Final = 40
"""Letters of reasons that take two lines in that column; more stand below the figures, across all columns, where they
take no more lines and leave the other columns in sight."""
BELOW_PX: Final = 360
"""Largest width of reasons below the figures of one of two answers: its table is wider than what is in sight."""
ROWS_PX: Final = 300
"""A residual plot that would leave less to the rows goes below them."""


RIMLESS_HINT: Final = "A glow, or one out of focus. Z undoes. Look at what is found: a face or a car may pass for it"


class CandidatesTable:
    """A table of the candidates of a window, the ball first; without a ball the reasons come before it."""

    def __init__(self, gui: viser.GuiApi, use_rimless: Callable[[], None]) -> None:
        self._nothing = gui.add_html("", visible=False)
        self._rimless = gui.add_button("Use the settings for a ball without a rim", visible=False, hint=RIMLESS_HINT)
        when_clicked(self._rimless, use_rimless)
        self._table = gui.add_html(stage_counts_html("Computing the first window ..."))

    def show(
        self,
        answers: tuple[tuple[str, WindowAnswer], ...],
        seconds: float,
        picked_px: tuple[float, float] | None = None,
        misses_px: tuple[float | None, ...] = (),
    ) -> None:
        """Show the candidates of each answer, under a title if there are several; a clicked one comes first.

        `misses_px` are their distances from the truth, see `miss_px`; empty if that is not shown.
        """
        several = len(answers) > 1
        tables = (
            answer_html(title if several else "", answer, picked_px, misses_px[number] if misses_px else None)
            for number, (title, answer) in enumerate(answers)
        )
        shown = side_by_side_html(tables) if several else "".join(tables)
        self._show(f"{shown}{stage_counts_html(f'picture made in {seconds * 1e3:.0f} ms')}")

    def show_verdicts(self, answers: tuple[tuple[str, WindowAnswer], ...], seconds: float) -> None:
        """Show only what each of several methods answers."""
        lines = "".join(verdict_html(title, answer) for title, answer in answers)
        self._show(lines + stage_counts_html(f"picture made in {seconds * 1e3:.0f} ms"))

    def _show(self, content: str) -> None:
        self._table.content = answer_of_window_html(content)

    def show_nothing_found(self, content: str, rimless: bool) -> None:
        """Show why nothing is found in the whole recording; nothing if empty. `rimless`: offer those settings."""
        self._nothing.content = answer_of_window_html(content)
        self._nothing.visible = bool(content)
        self._rimless.visible = rimless


def side_by_side_html(answers: Iterable[str]) -> str:
    """HTML of answers beside each other, or below where the panel is narrow."""
    cells = "".join(f"<div style='flex:1 1 {PAIR_PX}px;min-width:0'>{one}</div>" for one in answers)
    # The rows' own negative margin would draw a wrapped answer over the end of the one above it.
    return f"<div style='display:flex;flex-wrap:wrap;row-gap:8px'>{cells}</div>"


def answer_of_window_html(content: str) -> str:
    """HTML that the page greys while it is not the answer to what is asked, see `stale.js`."""
    return f"<div class='rallyscope-answer'>{content}</div>" if content else ""


def answer_html(
    title: str,
    answer: WindowAnswer,
    picked_px: tuple[float, float] | None = None,
    distance_px: float | None = None,
) -> str:
    """HTML of one answer with its candidates; `distance_px` is that from the truth, see `miss_px`."""
    trace = answer.trace
    if trace is None or not trace.titles:
        return verdict_html(title, answer, distance_px)
    picked = candidate_at(trace, picked_px)
    return candidates_html(title, trace, picked, facts=answer_facts(answer), distance_px=distance_px)


def verdict_html(title: str, answer: WindowAnswer, distance_px: float | None = None) -> str:
    """HTML of one answer without candidates."""
    label = f"{html_text(title)}: " if title else ""
    window = answer.window
    length_ms = (window.end_us - window.start_us) / 1e3
    lines = [
        f"{label}{_verdict(answer.detection, distance_px)} &middot; {len(window.events)} events in {length_ms:g} ms"
    ]
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
        late_ms = (answer.window.end_us - ball.t_us) / 1e3
        facts.append(f"position at {ball.t_us / 1e3:.3f} ms" + (f", {late_ms:.2f} ms old" if late_ms else ""))
    if isinstance(ball, RefinedDetection):
        sigma_px = float(ball.centre_covariance_px2.trace()) ** 0.5
        facts.append(f"moves ({ball.vu_px_per_ms:+.2f}, {ball.vv_px_per_ms:+.2f}) px/ms")
        facts.append(f"estimated error {sigma_px:.2f} px, {ball.fit.points:.0f} edge points")
    return facts


def _verdict(found: Detection | None, distance_px: float | None) -> str:
    if found is None:
        return f"<b style='color:{theme.BAD}'>no ball</b>"
    ball = f"ball at ({found.u_px:.1f}, {found.v_px:.1f}), radius {found.r_px:.1f} px"
    if distance_px is None:
        return f"<b style='color:{theme.GOOD}'>{ball}</b>"
    if math.isinf(distance_px):
        return f"<b style='color:{theme.BAD}'>{ball}: false, there is no ball at this time</b>"
    if is_wrong(distance_px):
        return f"<b style='color:{theme.BAD}'>{ball}: {distance_px:.1f} px off the true ball, not found</b>"
    return f"<b style='color:{theme.GOOD}'>{ball}</b>, {distance_px:.2f} px off the true ball"


def candidate_at(trace: MethodTrace, point_px: tuple[float, float] | None) -> int | None:
    """Label of the candidate with the event nearest to a point, within PICK_PX; None otherwise."""
    places = [one for one in trace.candidates if len(one.x_px)]
    if point_px is None or not places:
        return None
    nearest_px, label = min(
        (float(np.hypot(one.x_px - point_px[0], one.y_px - point_px[1]).min()), one.label) for one in places
    )
    return label if nearest_px <= PICK_PX else None


def candidates_html(
    name: str,
    trace: MethodTrace,
    picked: int | None = None,
    *,
    facts: Sequence[str] = (),
    distance_px: float | None = None,
) -> str:
    """HTML of the candidates of one window; the selected one comes first, highlighted, with its residuals."""
    verdict = _verdict(trace.detection, distance_px)
    ordered = sorted(trace.candidates, key=lambda one: (one.label != picked, bool(one.reasons), -one.order))
    # Before the figures: in the half of a panel the last columns are reached by scrolling only.
    titles = ("", trace.noun, "verdict", *trace.titles)
    head = table_row(titles, f"{CELL};text-align:left;font-weight:500;color:{theme.MUTED}", tag="th")
    below_px = BELOW_PX if name else None
    rows = "".join(_candidate_row(candidate, candidate.label == picked, below_px) for candidate in ordered[:LISTED])
    more = f"<div>and {len(ordered) - LISTED} more</div>" if len(ordered) > LISTED else ""
    label = f"{html_text(name)}: " if name else ""
    plural = "es" if trace.noun.endswith("x") else "s"
    count = "" if len(ordered) == 1 else f"{len(ordered)} {trace.noun}{plural}"  # a single one is the row below
    why = f": {reasons_html(trace.reasons)}" if trace.reasons and not ordered else ""
    parts = [one for one in (*facts, trace.where, count) if one]
    phrases = "".join(f" &middot; <span style='white-space:nowrap'>{one}</span>" for one in parts)
    summary = f"{label}{verdict}{why}{phrases}"
    shown = next((one for one in ordered if one.residuals is not None), None)
    plot = residuals_html(trace.noun, shown.label, shown.residuals) if shown is not None and shown.residuals else ""
    table = f"<table style='width:100%;border-spacing:0'>{head}{rows}</table>" if rows else ""
    scrolled = f"<div style='overflow-x:auto'>{table}</div>"
    rows_html = f"<div style='flex:1 1 {ROWS_PX}px;min-width:0'>{summary}{scrolled}{more}</div>"
    return f"<div style='{TIGHT};display:flex;flex-wrap:wrap;gap:0 12px'>{rows_html}{plot}</div>"


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


def _candidate_row(candidate: CandidateRow, picked: bool, below_px: int | None) -> str:
    """The row of a candidate; many reasons why it is no ball are a row of their own below it."""
    red, green, blue = palette("orange / blue")[cluster_colour_index(candidate.label)]
    swatch = f"<span style='color:rgb({red},{green},{blue})'>&#9632;</span>"
    reasons, why = reasons_html(candidate.reasons), ""
    if len("; ".join(one.text for one in candidate.reasons)) > LONGEST_IN_COLUMN:
        verdict = f"<span style='color:{theme.BAD}'>no ball</span>"
        width = "" if below_px is None else f"max-width:{below_px}px;"
        across = f"<td colspan='{len(candidate.figures) + 2}' style='{CELL}'>"
        why = f"<tr><td></td>{across}<div style='{width}white-space:normal'>{reasons}</div></td></tr>"
    elif reasons:
        wrapped = f"white-space:normal;display:inline-block;min-width:{REASONS_PX}px"
        verdict = f"<span style='{wrapped}'>{reasons}</span>"
    else:
        verdict = f"<span style='color:{theme.GOOD}'>{html_text(candidate.verdict)}</span>"
    cells = (swatch, candidate.label, verdict, *map(html_text, candidate.figures))
    return table_row(cells, CELL, row_style="background:rgba(255,140,40,0.25)" if picked else "") + why


class ResultsPanel:
    """A floating panel of one browser."""

    def __init__(
        self, gui: viser.GuiApi, start_score: Callable[[], None], cancel_score: Callable[[], None],
        use_rimless: Callable[[], None],
    ) -> None:  # fmt: skip
        self.panel = gui.add_panel(visible=False)
        with self.panel.add_tab("Candidates", viser.Icon.LIST_DETAILS):
            self.candidates = CandidatesTable(gui, use_rimless)
        with self.panel.add_tab("Score", viser.Icon.TARGET):
            self.score = ScorePanel(gui, start_score, cancel_score)
        with self.panel.add_tab("Auto-tune", viser.Icon.WAND):
            self._tuned = gui.add_html(stage_counts_html("No result yet. Start Auto-tune in the panel on the right"))
        place_below_pictures(gui, self.panel)

    def show_tuned(self, content: str) -> None:
        """Show the result of automatic tuning."""
        self._tuned.content = content
