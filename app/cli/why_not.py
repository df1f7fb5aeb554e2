"""Why there is no ball, for a terminal and as JSON: the reasons of a whole recording, and the table of one window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from app.cli.tables import format_table
from app.cli.terminal import print_lines, say
from core.detection.method_trace import CandidateRow, MethodTrace
from core.detection.reasons import FIXED, Reason, ReasonCount, ReasonCounter, number_text

LISTED: Final = 6
"""Most reasons printed for a recording."""
DIGITS: Final = 6
ROWS: Final = 40
"""Most candidates printed for a window."""


def why_not_summary(counter: ReasonCounter) -> list[dict[str, object]]:
    """Plain values of every reason, the most frequent first. A setting of None: the limit is fixed."""
    return [
        {
            "reason": one.reason,
            "setting": one.setting,
            "windows": one.windows,
            "value": None if one.value is None else round(one.value, DIGITS),
            "limit": None if one.limit is None else round(one.limit, DIGITS),
        }
        for one in counter.counts()
    ]


def say_why_not(counts: Sequence[dict[str, object]], windows: int, what: str) -> None:
    """Print the most frequent reasons of that many windows without a ball; nothing if all have one."""
    if not counts or not windows:
        return
    say(f"no ball in {windows} {what}; limits that the nearest candidate failed:")
    rows: list[dict[str, object]] = [
        {
            "share": f"{100 * _number(one['windows']) / windows:.0f} %",
            "reason": one["reason"],
            "median": _text(one["value"]),
            "limit": _text(one["limit"]),
            "setting": one["setting"] or FIXED,
        }
        for one in counts[:LISTED]
    ]
    print_lines(format_table(rows).split("\n"))


def say_trace(trace: MethodTrace, title: str) -> None:
    """Print the table of one window: what came into each stage and out of it, the candidates, the answer."""
    say(title)
    stages: list[dict[str, object]] = [
        {
            "stage": name,
            "in": f"{count.count_in} {count.unit_in or count.unit}",
            "out": f"{count.count_out} {count.unit}",
            "ms": "-" if count.seconds is None else f"{1e3 * count.seconds:.2f}",
        }
        for name, count in trace.counts.items()
    ]
    print_lines(format_table(stages).split("\n"))
    ordered = sorted(trace.candidates, key=lambda one: (bool(one.reasons), -one.order))
    if ordered:
        say()
        print_lines(format_table([_candidate(one, trace) for one in ordered[:ROWS]]).split("\n"))
    if len(ordered) > ROWS:
        say(f"and {len(ordered) - ROWS} more")
    say()
    ball = trace.detection
    if ball is not None:
        say(f"ball at ({ball.u_px:.2f}, {ball.v_px:.2f}) px, radius {ball.r_px:.2f} px, valid at {ball.t_us} us")
        return
    say("no ball: " + "; ".join(f"{one.text} ({one.setting or FIXED})" for one in trace.reasons))


def trace_summary(trace: MethodTrace) -> dict[str, object]:
    """Plain values of the table of one window."""
    ball = trace.detection
    return {
        "detection": None if ball is None else {name: getattr(ball, name) for name in ("t_us", "u_px", "v_px", "r_px")},
        "stages": [
            {"stage": name, "in": one.count_in, "out": one.count_out, "unit": one.unit, "seconds": one.seconds}
            for name, one in trace.counts.items()
        ],
        "candidates": [
            {
                trace.noun: one.label,
                **dict(zip(trace.titles, one.figures, strict=True)),
                "verdict": "rejected" if one.reasons else one.verdict,
                "reasons": [_reason(reason) for reason in one.reasons],
            }
            for one in trace.candidates
        ],
        "why_not": [_reason(reason) for reason in trace.reasons],
    }


def _reason(reason: Reason | ReasonCount) -> dict[str, object]:
    return {"reason": reason.reason, "setting": reason.setting, "value": reason.value, "limit": reason.limit}


def _candidate(row: CandidateRow, trace: MethodTrace) -> dict[str, object]:
    why = "; ".join(f"{one.text} ({one.setting or FIXED})" for one in row.reasons)
    return {trace.noun: row.label, **dict(zip(trace.titles, row.figures, strict=True)), "verdict": why or row.verdict}


def _number(value: object) -> float:
    assert isinstance(value, (int, float))
    return float(value)


def _text(value: object) -> str:
    return "-" if value is None else number_text(_number(value))
