"""The report's sections as values, and the report as Markdown and as one HTML page that needs nothing else."""

from __future__ import annotations

import base64
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from benchmarks.charts import CirclePanel, circle_panels
from benchmarks.machine import machine_words
from benchmarks.perception.comparisons import (
    COMPARISONS,
    CONDITIONS,
    DEFINITIONS,
    EVENT_BYTES,
    FEWEST_SEEDS,
    FIGURES,
    FRAME_DETECTOR,
    FRAMES,
    LIMITS,
    NO_FRAME_DETECTOR,
    NO_FRAMES,
    OVER_RECORDINGS,
    OVER_SEEDS,
    PAPER_LATENCY_SAVED,
    PAPER_SCENES,
    PICTURE_WORDS,
    PICTURES,
    READOUT_US,
    SCENES,
    TITLE,
    SeedEstimate,
    SeedRun,
    bytes_per_detection,
    compare,
    error_mean_px,
    error_px,
    estimate,
    frame_bytes_per_ball,
    hit_mm,
    latency_p50_ms,
    mean,
    one_line,
    paragraphs,
    percentile,
    point_mm,
    precision,
    ratio,
    recall,
    scene_verdict,
)
from benchmarks.perception.measure import SENSOR_DELAY_US
from benchmarks.perception.results import FRAME_METHODS, METHODS, ROWS, PerceptionResult, RecordingReading, ShownAnswer
from core.detection.methods import FRAME_METHODS as FRAME_METHOD_WORDS
from core.detection.methods import METHODS as METHOD_WORDS
from core.events import Events
from core.metrics.streaming import ASKED_EVERY_US
from core.recordings import PixelTruth, open_recording
from core.text import markdown_table

HALF_PX: Final = 22.0
"""What is drawn about the ball, to all sides."""
DRAWN_US: Final = 2000
"""The events of so long before the window's end."""


class WindowPicture(NamedTuple):
    """A PNG and its words."""

    png: bytes
    words: str


def draw_windows(run: SeedRun, folder: Path) -> list[WindowPicture]:
    """A picture of each recording in the folder with a ball to see, every method's answer a panel."""
    pictures: list[WindowPicture] = []
    for reading in run.readings:
        results = {one.method: one for one in run.results if one.recording == reading.recording}
        chosen = [results[method] for method in METHODS if method in results]
        if reading.shown_us is not None and chosen:
            pictures.append(draw_window(folder / f"{reading.recording}.h5", reading, chosen))
    return pictures


def draw_window(path: Path, reading: RecordingReading, results: Sequence[PerceptionResult]) -> WindowPicture:
    """The window of the reading, in the first camera's picture."""
    end_us = reading.shown_us
    assert end_us is not None
    with open_recording(path) as recording:
        name, stream = next(iter(recording.cameras.items()))
        events, truth = stream.slice(end_us - DRAWN_US, end_us), stream.truth
    assert truth is not None
    png = circle_panels([_panel(one, events, truth, end_us) for one in results], half_px=HALF_PX)
    seconds = f"{1e-6 * end_us:.3f} s"
    said = "; ".join(f"{one.method}: {_words(one.shown, truth)}" for one in results)
    return WindowPicture(png, f"{reading.recording} ({reading.scene}), camera {name}, {seconds}. {said}.")


def off_px(answer: ShownAnswer, truth: PixelTruth) -> float:
    """Distance from the ball at the time that the answer states; nan if there was none."""
    at = truth.at(answer.t_us)
    return math.hypot(answer.u_px - float(at.u_px[0]), answer.v_px - float(at.v_px[0]))


def _panel(result: PerceptionResult, events: Events, truth: PixelTruth, end_us: int) -> CirclePanel:
    said = result.shown
    at = truth.at(end_us if said is None else said.t_us)
    places = np.column_stack([events.x_px, events.y_px]).astype(np.float64)
    return CirclePanel(
        title=f"{result.method}\n{_words(said, truth)}",
        on_px=places[events.on],
        off_px=places[~events.on],
        truth=(float(at.u_px[0]), float(at.v_px[0]), float(at.r_px[0])),
        answer=None if said is None else (said.u_px, said.v_px, said.r_px),
    )


def _words(said: ShownAnswer | None, truth: PixelTruth) -> str:
    if said is None:
        return "no answer"
    off = off_px(said, truth)
    return "no ball at its time" if math.isnan(off) else f"{off:.2f} px off"


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A heading, paragraphs with `code` in backticks, and a table if there are columns."""

    title: str
    paragraphs: tuple[str, ...]
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


def report_sections(runs: Sequence[SeedRun], machine: Mapping[str, object]) -> list[ReportSection]:
    """All of the report but its pictures."""
    return [
        _conditions(runs, machine),
        _accuracy(runs),
        _cost(runs),
        _comparisons(runs),
        _in_time(runs),
        _scenes(runs),
        _limits(runs),
        _recordings(runs),
        _definitions(),
    ]


def cell(found: SeedEstimate, form: str, scale: float = 1.0) -> str:
    """A figure with its interval; "-" if nobody knows it."""
    if math.isnan(found.value):
        return "-"
    value, low, high = (_number(scale * one, form) for one in found)
    return value if math.isnan(found.low) else f"{value} [{low}, {high}]"


def _number(value: float, form: str) -> str:
    return "never" if math.isinf(value) else format(value, form)


def _conditions(runs: Sequence[SeedRun], machine: Mapping[str, object]) -> ReportSection:
    seeds = ", ".join(str(run.seed) for run in runs)
    few = len(runs) < FEWEST_SEEDS
    brackets = one_line(OVER_RECORDINGS, fewest=FEWEST_SEEDS) if few else one_line(OVER_SEEDS)
    filled = {
        "seeds": seeds,
        "count": len(runs),
        "brackets": brackets,
        "machine": machine_words(machine),
        "frame_detector": _frame_detector_words(runs),
    }
    return ReportSection("Conditions", paragraphs(CONDITIONS, **filled))


def _frame_detector_words(runs: Sequence[SeedRun]) -> str:
    sharp = [one.sharp_recall for run in runs for method in FRAME_METHODS for one in run.of(method)]
    known = [value for value in sharp if value is not None]
    return one_line(FRAME_DETECTOR, sharp=f"{min(known):.3f}") if known else one_line(NO_FRAME_DETECTOR)


def _accuracy(runs: Sequence[SeedRun]) -> ReportSection:
    forms = {
        "precision": ".3f", "recall": ".3f", "error_mean_px": ".2f", "error_median_px": ".2f", "error_p95_px": ".2f",
        "point_median_mm": ".2f", "point_p95_mm": ".1f", "hit_median_mm": ".1f", "hit_p95_mm": ".1f",
        "hits_told": ".2f", "delay_us": ".0f",
    }  # fmt: skip
    columns = (
        "method", "precision", "recall", "error mean px", "median", "p95", "3D median mm", "p95",
        "hitting point median mm", "p95", "share of balls with a prediction", "delay taken out us",
    )  # fmt: skip
    return ReportSection("What is found, and how exactly", (_methods(),), columns, _figure_rows(runs, forms))


def _cost(runs: Sequence[SeedRun]) -> ReportSection:
    forms = {
        "bytes_per_detection": ",.0f", "cpu_p50_ms": ".3f", "cpu_p99_ms": ".3f", "latency_p50_ms": ".2f",
        "latency_p99_ms": ".2f", "recovery_median_ms": ".1f", "never_found": ".2f",
    }  # fmt: skip
    columns = (
        "method", "bytes per detection", "CPU p50 ms", "p99", "light to answer p50 ms", "p99", "recovery median ms",
        "never found",
    )  # fmt: skip
    return ReportSection("What it costs, and how soon", (), columns, _figure_rows(runs, forms))


def _in_time(runs: Sequence[SeedRun]) -> ReportSection:
    forms = {
        "age_median_ms": ".2f", "age_p95_ms": ".1f", "held_median_px": ".2f", "moved_median_px": ".2f",
        "moved_p95_px": ".2f",
    }  # fmt: skip
    columns = ("method", "age of the newest answer median ms", "p95", "held, median px", "moved on, median px", "p95")
    return ReportSection("What a robot would have in time", (), columns, _figure_rows(runs, forms))


def _methods() -> str:
    said = {**METHOD_WORDS, **FRAME_METHOD_WORDS}
    return "; ".join(f"`{method}`: {said[method]}" for method in ROWS) + "."


def _figure_rows(runs: Sequence[SeedRun], forms: Mapping[str, str]) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (f"`{method}`", *(cell(estimate(runs, method, FIGURES[name]), form) for name, form in forms.items()))
        for method in ROWS
    )


def _comparisons(runs: Sequence[SeedRun]) -> ReportSection:
    rows = [(one.claim, one.how, one.paper, one.ours, one.verdict) for one in compare(runs)]
    fastest = min(METHODS, key=lambda method: estimate(runs, method, latency_p50_ms).value)
    least_ms = estimate(runs, fastest, latency_p50_ms).value
    text = paragraphs(
        COMPARISONS,
        method=fastest,
        least_ms=least_ms,
        saved=100 * PAPER_LATENCY_SAVED,
        frame_ms=least_ms / (1 - PAPER_LATENCY_SAVED),
        frames=_frame_words(runs),
    )
    columns = ("the paper's claim", "how", "paper", "here", "holds here?")
    return ReportSection("The paper's comparisons", text, columns, tuple(rows))


def _frame_words(runs: Sequence[SeedRun]) -> str:
    readings = [one for run in runs for one in run.readings if one.frame_period_us]
    if not readings:
        return NO_FRAMES
    exposure_ms = 1e-3 * mean([one.exposure_us for one in readings])
    return one_line(
        FRAMES,
        wait_ms=exposure_ms / 2,
        exposure_ms=exposure_ms,
        period_ms=1e-3 * mean([one.frame_period_us for one in readings]),
        readout_ms=1e-3 * READOUT_US,
        megabytes=1e-6 * mean([frame_bytes_per_ball(run.readings) for run in runs]),
    )


def _scenes(runs: Sequence[SeedRun]) -> ReportSection:
    rows = []
    for name, paper in PAPER_SCENES.items():
        for method in ("paper", "auto", "refined"):
            results = [one for run in runs for one in run.of(method, [name])]
            figures = [figure(results) for figure in (precision, recall, error_mean_px, error_px(50))]
            cells = [_known(value, form) for value, form in zip(figures, (".3f", ".3f", ".2f", ".2f"), strict=True)]
            theirs = (f"{paper.precision:.3f}", f"{paper.recall:.3f}", f"{paper.error_px:.2f}")
            both = (f"{cells[0]} / {theirs[0]}", f"{cells[1]} / {theirs[1]}")
            errors = f"{cells[2]} (median {cells[3]}) / {theirs[2]}"
            rows.append((name, f"`{method}`", *both, errors, scene_verdict(results, paper)))
    columns = ("recording", "method", "precision", "recall", "error px", "holds here?")
    return ReportSection("The paper's four scenes with people", paragraphs(SCENES), columns, tuple(rows))


def _limits(runs: Sequence[SeedRun]) -> ReportSection:
    read_ns = mean([one.read_ns for run in runs for one in run.readings])
    rows = []
    for method in METHODS:
        results = [one for run in runs for one in run.of(method)]
        events = ratio(sum(one.events for one in results), sum(one.windows for one in results))
        floor_us, cpu_us = 1e-3 * read_ns * events, 1e3 * percentile((one.cpu_ms for one in results), 50)
        bound = percentile((one.bound_px for one in results), 50)
        pixels = percentile((one.pixel_bound_px for one in results), 50)
        error = percentile((one.error_px for one in results), 50)
        rows.append(
            (f"`{method}`", _known(events, ",.0f"), _known(floor_us, ".2f"), _known(cpu_us, ".0f"),
             _known(ratio(cpu_us, floor_us), ",.0f"), _known(bound, ".3f"), _known(pixels, ".3f"), _known(error, ".3f"),
             _known(ratio(error, pixels), ".1f"))
        )  # fmt: skip
    text = paragraphs(LIMITS, read_ns=read_ns)
    columns = (
        "method", "events per window", "read once us", "CPU p50 us", "CPU / read", "bound median px: events", "pixels",
        "error median px", "error / pixels",
    )  # fmt: skip
    return ReportSection("The limits beside them", text, columns, tuple(rows))


def _recordings(runs: Sequence[SeedRun]) -> ReportSection:
    figures = (
        (precision, ".3f"), (recall, ".3f"), (error_mean_px, ".2f"), (error_px(50), ".2f"), (error_px(95), ".2f"),
        (point_mm(50), ".2f"), (point_mm(95), ".1f"), (hit_mm(50), ".1f"), (bytes_per_detection, ",.0f"),
    )  # fmt: skip
    rows = []
    for reading in runs[0].readings if runs else ():
        for method in ROWS:
            results = [one for run in runs for one in run.of(method, [reading.recording])]
            hits = f"{sum(len(one.hit_mm) for one in results)} of {sum(one.hits for one in results)}"
            cells = (_known(figure(results), form) for figure, form in figures)
            rows.append((f"{reading.recording} {reading.scene}", f"`{method}`", *cells, hits))
    columns = (
        "recording", "method", "precision", "recall", "error mean px", "median", "p95", "3D median mm", "p95",
        "hitting point median mm", "bytes per detection", "balls with a prediction",
    )  # fmt: skip
    return ReportSection(
        "Recording by recording",
        ("All seeds together. All are simulated: real1 to real7 are modelled on the paper's recordings.",),
        columns,
        tuple(rows),
    )


def _definitions() -> ReportSection:
    delays = {"delay_ms": 1e-3 * SENSOR_DELAY_US, "readout_ms": 1e-3 * READOUT_US}
    filled = {"event_bytes": EVENT_BYTES, "every_us": ASKED_EVERY_US, **delays}
    return ReportSection("How it is measured", paragraphs(DEFINITIONS, **filled))


def _known(value: float, form: str) -> str:
    return "-" if math.isnan(value) else _number(value, form)


LINE: Final = 118
"""Characters of a line of Markdown."""
BEFORE_PICTURES: Final = 4
"""Sections: the conditions, the two tables of figures, and the comparisons."""
STYLE: Final = """
:root { color-scheme: light; }
body { margin: 2rem auto; max-width: 76rem; padding: 0 1.5rem; background: #fff; color: #222;
  font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.7rem; } h2 { margin-top: 2.2rem; font-size: 1.2rem; color: #b4510b; }
p { max-width: 60rem; } code { background: #f4f1ec; padding: 0 .25em; border-radius: 3px; font-size: .92em; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .86rem; }
th, td { padding: .35rem .7rem; border-bottom: 1px solid #e3ddd3; text-align: left; vertical-align: top; }
th { background: #faf6ef; } tbody tr:hover { background: #fdfaf5; }
td code { white-space: nowrap; } small { color: #777; white-space: nowrap; }
figure { margin: 1.5rem 0; } img { max-width: 100%; border: 1px solid #e3ddd3; }
figcaption { font-size: .86rem; color: #555; }
"""


def markdown_page(sections: Sequence[ReportSection], html_name: str) -> str:
    """The report as Markdown; the pictures are in the HTML page of that name beside it."""
    parts = [f"# {TITLE}\n", f"With pictures, as one page for the browser: [{html_name}]({html_name}).\n"]
    for section in sections:
        parts.append(f"## {section.title}\n")
        parts += [_wrapped(paragraph) for paragraph in section.paragraphs]
        if section.columns:
            parts.append(markdown_table(section.columns, section.rows))
    return "\n".join(parts)


def _wrapped(paragraph: str) -> str:
    return textwrap.fill(paragraph, LINE, break_long_words=False, break_on_hyphens=False) + "\n"


def html_page(sections: Sequence[ReportSection], pictures: Sequence[WindowPicture]) -> str:
    """The page as HTML with embedded pictures: no script, no other file."""
    written = [_section(section) for section in sections]
    body = "\n".join([*written[:BEFORE_PICTURES], _figures(pictures), *written[BEFORE_PICTURES:]])
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(TITLE)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(TITLE)}</h1>\n{body}\n</body>\n</html>\n"
    )


def inline_html(text: str) -> str:
    """Text with `code` in backticks as HTML; everything else is text."""
    return re.sub("`([^`]*)`", r"<code>\1</code>", escape(text))


def _section(section: ReportSection) -> str:
    parts = [f"<h2>{inline_html(section.title)}</h2>"]
    parts += [f"<p>{inline_html(paragraph)}</p>" for paragraph in section.paragraphs]
    if section.columns:
        head = "".join(f"<th>{inline_html(column)}</th>" for column in section.columns)
        rows = "\n".join(
            "<tr>" + "".join(f"<td>{_value(value)}</td>" for value in row) + "</tr>" for row in section.rows
        )
        table = f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>"
        parts.append(f'<div class="wide">{table}</div>')
    return "\n".join(parts)


def _value(text: str) -> str:
    """A cell, its interval on a line of its own."""
    return re.sub(r" (\[[^\]]*\])$", r"<br><small>\1</small>", inline_html(text))


def _figures(pictures: Sequence[WindowPicture]) -> str:
    if not pictures:
        return ""
    parts = [f"<h2>{PICTURES}</h2>", f"<p>{escape(one_line(PICTURE_WORDS))}</p>"]
    for picture in pictures:
        data, words = base64.b64encode(picture.png).decode(), escape(picture.words)
        image = f'<img alt="{words}" src="data:image/png;base64,{data}">'
        parts.append(f"<figure>{image}<figcaption>{words}</figcaption></figure>")
    return "\n".join(parts)
