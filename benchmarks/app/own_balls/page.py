"""The result as a page of Markdown: the figures, how well people agree, and the card to fill in."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, Final

from benchmarks.machine import machine_words
from core.text.markdown_table import markdown_table
from core.text.plain_text import plain

LINE: Final = 118
HOW: Final = """
Every method is asked at the instants that a person labelled, with a lead-in of 20 ms or ten windows before one that
stands alone. An answer within 8 px of the labelled centre is right; precision counts the answers at labels, recall the
labels with a ball. In brackets are 95 % intervals: Wilson's for shares, as if each ball had been asked about once,
and of errors a bootstrap over balls, from three balls on; a ball ends where no camera has a label for 100 ms. CPU is
the processor time of one thread for a step that answered. Errors have those of the labels in them.
"""
TO_FILL_IN: Final = (
    "lenses", "biases (the file)", "distance and placement", "light", "ball (colour, wear)", "who played",
    "balls at which speed", "what was left out, and why",
)  # fmt: skip
"""What no file knows."""


def own_balls_page(told: Mapping[str, Any]) -> str:
    """All of it, from what the bench returns."""
    card, rows = told["card"], told["rows"]
    parts = ["# Perception: a set of balls of one's own\n", _wrapped(HOW)]
    parts += [_wrapped(f"**{plain(remark[0].upper() + remark[1:])}.**") for remark in told["remarks"]]
    titles = (
        "annotator", "labels", "number", "balls", "method", "precision", "recall", "error mean px", "median", "p95",
        "along the motion", "CPU p50 ms", "p99",
    )  # fmt: skip
    parts += ["## What is found, and how exactly\n", markdown_table(titles, [_row(row) for row in rows])]
    parts += ["## How well people agree\n", _agreement(told["agreement"])]
    parts += ["## Recording by recording\n"]
    columns = ("recording", "annotator", "labels", "balls", "method", "precision", "recall", "median px", "p95")
    parts.append(markdown_table(columns, [_recording_row(row) for row in told["recordings"]]))
    parts += ["## The card\n", *_card(card), _wrapped(f"Measured on: {machine_words(told['machine'])}.")]
    return "\n".join(parts)


def _wrapped(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), LINE, break_long_words=False, break_on_hyphens=False) + "\n"


def _figure(row: Mapping[str, Any], name: str, form: str, bounds: tuple[str, str] | None = None) -> str:
    if row[name] is None:
        return "-"
    value = format(row[name], form)
    if bounds is None or row[bounds[0]] is None:
        return value
    return f"{value} [{format(row[bounds[0]], form)}, {format(row[bounds[1]], form)}]"


def _row(row: Mapping[str, Any]) -> tuple[object, ...]:
    return (
        plain(row["annotator"]), row["group"], str(row["labels"]), str(row["balls"]), f"`{row['method']}`",
        _figure(row, "precision", ".3f", ("precision_low", "precision_high")),
        _figure(row, "recall", ".3f", ("recall_low", "recall_high")),
        _figure(row, "error_mean_px", ".2f"),
        _figure(row, "error_median_px", ".2f", ("error_median_low_px", "error_median_high_px")),
        _figure(row, "error_p95_px", ".2f", ("error_p95_low_px", "error_p95_high_px")),
        _figure(row, "along_px", "+.2f"), _figure(row, "cpu_p50_ms", ".3f"), _figure(row, "cpu_p99_ms", ".3f"),
    )  # fmt: skip


def _recording_row(row: Mapping[str, Any]) -> tuple[object, ...]:
    figures = (("precision", ".3f"), ("recall", ".3f"), ("error_median_px", ".2f"), ("error_p95_px", ".2f"))
    names = (plain(row["recording"]), plain(row["annotator"]), str(row["labels"]), str(row["balls"]))
    return (*names, f"`{row['method']}`", *(_figure(row, name, form) for name, form in figures))


def _agreement(pairs: Sequence[Mapping[str, Any]]) -> str:
    if not pairs:
        return "Nobody has looked at the same instant twice.\n"
    titles = ("first", "second", "common", "same state", "both see the ball", "median px", "p95", "sigma of one")
    rows = [
        (
            plain(one["first"]), plain(one["second"] if one["second"] != one["first"] else "second looks"),
            str(one["common"]), str(one["same_state"]), str(one["both_seen"]),
            _figure(one, "median_px", ".2f", ("median_low_px", "median_high_px")), _figure(one, "p95_px", ".2f"),
            _figure(one, "sigma_px", ".2f"),
        )
        for one in pairs
    ]  # fmt: skip
    return markdown_table(titles, rows)


def _card(card: Mapping[str, Any]) -> list[str]:
    titles = ("recording", "seconds", "cameras", "million events", "labels", "notes")
    rows = [
        (
            plain(one["recording"]), f"{one['seconds']:.1f}", plain("; ".join(one["cameras"])),
            f"{1e-6 * one['events']:.2f}", str(one["labels"]), str(len(one["notes"])),
        )
        for one in card["recordings"]
    ]  # fmt: skip
    lines = []
    for name, said in card["annotators"].items():
        how, what = (
            ", ".join(f"{key.replace('_', ' ')} {count}" for key, count in said[part].items())
            for part in ("by_source", "by_state")
        )
        lines.append((plain(name), str(said["labels"]), how, what, str(said["second_looks"])))
    made = ("annotator", "labels", "how they came about", "what they say", "second looks")
    asked = "".join(f"- {what}:\n" for what in TO_FILL_IN)
    return [markdown_table(titles, rows), markdown_table(made, lines), "What no file knows:\n", asked]
