"""HTML of what a method answers to one window: the verdict, its candidates with their figures, why there is no ball."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app import theme
from app.formatting import html_text, table_row
from app.modes.tune.residuals_plot import residuals_html
from app.modes.tune.settings import setting_anchor
from app.pictures.palette import palette
from app.views.requests import is_wrong
from app.views.stage_picture import cluster_colour_index
from core.detection import Detection, RefinedDetection
from core.detection.method_trace import CandidateRow, MethodTrace
from core.detection.reasons import FIXED, Reason, ReasonCount
from core.metrics.run import WindowAnswer
from core.text import counted

LISTED = 40
PICK_PX = 6.0
"""Largest distance of a click from a candidate's nearest event that selects it."""
TIGHT: Final = "font-size:12.5px;line-height:15px;padding:0 12px;margin-top:-6px"
CELL: Final = "padding:0 10px 0 0;white-space:nowrap"
"""CSS of a table cell: no height is spent, so that four clusters fit into a window of 1280x720 without scrolling."""
PAIR_PX: Final = 400
"""Two answers without candidates stand side by side if each gets this width."""
REASONS_PX: Final = 130
"""Width of a column of reasons, which would else wrap at each word."""
LONGEST_IN_COLUMN: Final = 40
"""Letters of reasons that take two lines in that column; more stand below the figures, across all columns, where they
take no more lines and leave the other columns in sight."""
ROWS_PX: Final = 300
"""A residual plot that would leave less to the rows goes below them."""


def side_by_side_html(answers: Iterable[str]) -> str:
    """HTML of answers beside each other, or below where the panel is narrow."""
    cells = "".join(f"<div style='flex:1 1 {PAIR_PX}px;min-width:0'>{one}</div>" for one in answers)
    # The rows' own negative margin would draw a wrapped answer over the end of the one above it.
    return f"<div style='display:flex;flex-wrap:wrap;row-gap:8px'>{cells}</div>"


def answer_of_window_html(content: str) -> str:
    """HTML that the page greys while it is not the answer to what is asked, see `stale.js`."""
    return f"<div class='rallyscope-answer'>{content}</div>" if content else ""


def answer_html(
    answer: WindowAnswer, picked_px: tuple[float, float] | None = None, distance_px: float | None = None
) -> str:
    """HTML of one answer with its candidates; `distance_px` is that from the truth, see `miss_px`."""
    trace = answer.trace
    if trace is None or not trace.titles:
        return verdict_html("", answer, distance_px)
    picked = candidate_at(trace, picked_px)
    return candidates_html(trace, picked, facts=answer_facts(answer), distance_px=distance_px)


def answers_html(
    answers: Sequence[tuple[str, WindowAnswer]],
    misses_px: Sequence[float | None],
    picked_px: tuple[float, float] | None = None,
) -> str:
    """HTML of the answers of several configs to one window, each called by its title; `misses_px` as `miss_px`."""
    if any(one.trace is None or not one.trace.titles for _, one in answers):
        return side_by_side_html(
            verdict_html(title, one, px) for (title, one), px in zip(answers, misses_px, strict=True)
        )
    compared = [
        ComparedTrace(title, one.trace, answer_facts(one), px)
        for (title, one), px in zip(answers, misses_px, strict=True)
        if one.trace is not None
    ]
    return compared_html(compared, picked_px)


def verdict_html(title: str, answer: WindowAnswer, distance_px: float | None = None) -> str:
    """HTML of one answer without candidates."""
    label = f"{html_text(title)}: " if title else ""
    window = answer.window
    length_ms = (window.end_us - window.start_us) / 1e3
    events = counted(len(window.events), "event")
    lines = [f"{label}{_verdict(answer.detection, distance_px)} &middot; {events} in {length_ms:g} ms"]
    lines += [reasons_html(answer.reasons)] if answer.reasons else []
    lines += answer_facts(answer)
    before = answer.lead_in_windows
    used = f"{counted(before, 'earlier window')} used" if before else "No earlier windows used (start of the recording)"
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
    trace: MethodTrace,
    picked: int | None = None,
    *,
    facts: Sequence[str] = (),
    distance_px: float | None = None,
) -> str:
    """HTML of the candidates of one window; the selected one comes first, highlighted, with its residuals."""
    ordered = _ordered(trace, picked)
    rows = [_candidate_row(candidate, candidate.label == picked) for candidate in ordered]
    summary = _summary_html(trace, facts, distance_px)
    rows_html = f"<div style='flex:1 1 {ROWS_PX}px;min-width:0'>{summary}{_table_html(trace, rows)}</div>"
    plot = _plot_html(trace, ordered)
    return f"<div style='{TIGHT};display:flex;flex-wrap:wrap;gap:0 12px'>{rows_html}{plot}</div>"


@dataclass(frozen=True, slots=True, eq=False)
class ComparedTrace:
    """How one of several configs came to its answer."""

    title: str
    """Such as "Config A"; its last word names the rows."""
    trace: MethodTrace
    facts: Sequence[str] = ()
    distance_px: float | None = None
    """Distance from the truth, see `miss_px`."""


def compared_html(compared: Sequence[ComparedTrace], picked_px: tuple[float, float] | None = None) -> str:
    """HTML of the candidates of several configs of one method: an answer each, then all rows in one table.

    Two tables beside each other would both have to be scrolled sideways in a window of 1280 px.
    """
    summaries, columns, plots = "", [], ""
    for one in compared:
        picked = candidate_at(one.trace, picked_px)
        ordered, name = _ordered(one.trace, picked), html_text(one.title.rpartition(" ")[2])
        columns.append([_candidate_row(candidate, candidate.label == picked, (name,)) for candidate in ordered])
        summaries += f"<div>{html_text(one.title)}: {_summary_html(one.trace, one.facts, one.distance_px)}</div>"
        plots += _plot_html(one.trace, ordered, f"{one.title}, ")
    # The best of each on top: what differs is seen without scrolling.
    rows = [row for each in itertools.zip_longest(*columns) for row in each if row is not None]
    table = _table_html(compared[0].trace, rows, ("config",))
    beside = f"<div style='display:flex;flex-wrap:wrap;gap:0 12px'>{plots}</div>" if plots else ""
    return f"<div style='{TIGHT}'>{summaries}{table}{beside}</div>"


def _ordered(trace: MethodTrace, picked: int | None) -> list[CandidateRow]:
    """The candidates as they are listed: the picked one, the ball, then the others by size."""
    return sorted(trace.candidates, key=lambda one: (one.label != picked, bool(one.reasons), -one.order))


def _summary_html(trace: MethodTrace, facts: Sequence[str], distance_px: float | None) -> str:
    """What was found, else why nothing was, and how many candidates there are; a single one is the row below."""
    count = "" if len(trace.candidates) == 1 else counted(len(trace.candidates), trace.noun)
    why = f": {reasons_html(trace.reasons)}" if trace.reasons and not trace.candidates else ""
    parts = [one for one in (*facts, trace.where, count) if one]
    phrases = "".join(f" &middot; <span style='white-space:nowrap'>{one}</span>" for one in parts)
    return f"{_verdict(trace.detection, distance_px)}{why}{phrases}"


def _table_html(trace: MethodTrace, rows: Sequence[str], first: tuple[str, ...] = ()) -> str:
    """A table of rows as `_candidate_row` makes them with as many cells in front; nothing without rows."""
    if not rows:
        return ""
    # The verdict before the figures: in a narrow panel the last columns are reached by scrolling only.
    titles = (*first, "", trace.noun, "verdict", *trace.titles)
    head = table_row(titles, f"{CELL};text-align:left;font-weight:500;color:{theme.MUTED}", tag="th")
    table = f"<table style='width:100%;border-spacing:0'>{head}{''.join(rows[:LISTED])}</table>"
    more = f"<div>and {len(rows) - LISTED} more</div>" if len(rows) > LISTED else ""
    return f"<div style='overflow-x:auto'>{table}</div>{more}"


def _plot_html(trace: MethodTrace, ordered: Sequence[CandidateRow], whose: str = "") -> str:
    """The residuals of the first candidate that has some; empty without one."""
    shown = next((one for one in ordered if one.residuals is not None), None)
    if shown is None or not shown.residuals:
        return ""
    return residuals_html(f"{whose}{trace.noun}", shown.label, shown.residuals)


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


def _candidate_row(candidate: CandidateRow, picked: bool, first: tuple[str, ...] = ()) -> str:
    """The row of a candidate, after cells with `first`; many reasons why it is no ball are a row of their own."""
    red, green, blue = palette("orange / blue")[cluster_colour_index(candidate.label)]
    swatch = f"<span style='color:rgb({red},{green},{blue})'>&#9632;</span>"
    reasons, why = reasons_html(candidate.reasons), ""
    if len("; ".join(one.text for one in candidate.reasons)) > LONGEST_IN_COLUMN:
        verdict = f"<span style='color:{theme.BAD}'>no ball</span>"
        across = f"<td colspan='{len(candidate.figures) + 2}' style='{CELL}'>"
        before = "<td></td>" * (1 + len(first))
        why = f"<tr>{before}{across}<div style='white-space:normal'>{reasons}</div></td></tr>"
    elif reasons:
        wrapped = f"white-space:normal;display:inline-block;min-width:{REASONS_PX}px"
        verdict = f"<span style='{wrapped}'>{reasons}</span>"
    else:
        verdict = f"<span style='color:{theme.GOOD}'>{html_text(candidate.verdict)}</span>"
    cells = (*first, swatch, candidate.label, verdict, *map(html_text, candidate.figures))
    return table_row(cells, CELL, row_style="background:rgba(255,140,40,0.25)" if picked else "") + why
