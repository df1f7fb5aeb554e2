"""What a comparison of methods says: the table of its figures, and the names of its misses."""

from __future__ import annotations

import math
from typing import Final

from app import theme
from app.formatting.file_text import html_text
from app.modes.tune.compare.run import CompareAnswer, ComparedMethod
from app.pictures.palette import METHOD_RGB
from core.detection.methods import Method
from core.metrics.compare import ErrorRun

MAX_STRETCHES: Final = 40
"""That have a button; the longest ones."""
CELL: Final = "padding-right:8px;white-space:nowrap"


def comparison_html(answer: CompareAnswer) -> str:
    """A row for each method, and what is taken for right."""
    agreement = answer.kind == "method"
    name = html_text(answer.reference)
    titles = ("", "shared" if agreement else "recall", "precision", "px p50 / p95", "ms p50 / p99")
    head = "".join(f"<th style='text-align:left;font-weight:500;{CELL}'>{title}</th>" for title in titles)
    rows = "".join(_row(one) for one in answer.methods)
    said = f"against {name}: a ball counts as found within 8 px"
    if agreement:
        said = (
            f"<b>agreement with {name}, not error</b>: shared is how many of its balls a method has too, "
            f"within 8 px, and px how far apart they are"
        )
        if answer.nothing_known:
            said = f"this camera has neither truth nor labels. {said}"
    muted = f"color:{theme.MUTED}"
    return (
        f"<div style='font-size:12px;padding:4px 8px'>{html_text(answer.title)}"
        f"<table><tr>{head}</tr>{rows}</table>"
        f"<div style='{muted}'>{said}. ms: processor time of a window of each method's own length.</div></div>"
    )


def method_css(method: Method) -> str:
    """The colour of a method."""
    red, green, blue = METHOD_RGB[method]
    return f"rgb({red},{green},{blue})"


def stretch_names(stretches: tuple[ErrorRun, ...]) -> dict[str, ErrorRun]:
    """The longest ones by the names of their buttons, in order of time; no two names are alike."""
    longest = sorted(stretches, key=lambda one: -one.count)[:MAX_STRETCHES]
    names: dict[str, ErrorRun] = {}
    for one in sorted(longest, key=lambda one: one.start_us):
        times = f" ×{one.count}" if one.count > 1 else ""
        names[f"{one.start_us / 1e6:.4f} s{times}"] = one
    return names


def stretches_html(answer: CompareAnswer, method: Method, *, missed: bool) -> str:
    """What the buttons below are."""
    (one,) = (one for one in answer.methods if one.method == method)
    stretches = one.missed if missed else one.false
    count = sum(stretch.count for stretch in stretches)
    if missed:
        what = f"{count} of {len(one.judged.asked_us)} times asked are missed"
    else:
        what = f"{count} of {len(one.judged.t_us)} answers are false"
    if answer.kind == "method":
        what += f", if {html_text(answer.reference)} is right"
    more = len(stretches) - MAX_STRETCHES
    rest = f", the {MAX_STRETCHES} longest of them" if more > 0 else ""
    where = "in one stretch" if len(stretches) == 1 else f"in {len(stretches)} stretches"
    places = f", {where}{rest}: choose one to look at it" if stretches else ""
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:0 12px'>{what}{places}</div>"


def _row(one: ComparedMethod) -> str:
    judged = one.judged
    cells = (
        f"<span style='color:{method_css(one.method)}'>●</span> {one.method}",
        _ratio(judged.recall),
        _ratio(judged.precision),
        f"{_number(judged.error_at(50))} / {_number(judged.error_at(95))}",
        f"{_number(1e3 * judged.step_at(50))} / {_number(1e3 * judged.step_at(99))}",
    )
    return "<tr>" + "".join(f"<td style='{CELL}'>{cell}</td>" for cell in cells) + "</tr>"


def _ratio(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2f}"
