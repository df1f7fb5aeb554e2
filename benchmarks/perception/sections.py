"""The report's sections as values: the Markdown page and the HTML page write the same ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.machine import machine_words
from benchmarks.perception import words
from benchmarks.perception.comparisons import (
    PAPER_LATENCY_SAVED,
    PAPER_SCENES,
    compare,
    frame_bytes_per_ball,
    scene_verdict,
)
from benchmarks.perception.limits import SENSOR_DELAY_US
from benchmarks.perception.plan import FRAME_METHODS, METHODS, ROWS
from benchmarks.perception.summary import (
    EVENT_BYTES,
    FEWEST_SEEDS,
    FIGURES,
    READOUT_US,
    SeedEstimate,
    SeedRun,
    bytes_per_detection,
    error_mean_px,
    error_px,
    estimate,
    hit_mm,
    latency_p50_ms,
    mean,
    percentile,
    point_mm,
    precision,
    ratio,
    recall,
)
from benchmarks.perception.words import one_line, paragraphs
from core.detection.methods import FRAME_METHODS as FRAME_METHOD_WORDS
from core.detection.methods import METHODS as METHOD_WORDS


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
    brackets = one_line(words.OVER_RECORDINGS, fewest=FEWEST_SEEDS) if few else one_line(words.OVER_SEEDS)
    filled = {
        "seeds": seeds,
        "count": len(runs),
        "brackets": brackets,
        "machine": machine_words(machine),
        "frame_detector": _frame_detector_words(runs),
    }
    return ReportSection("Conditions", paragraphs(words.CONDITIONS, **filled))


def _frame_detector_words(runs: Sequence[SeedRun]) -> str:
    sharp = [one.sharp_recall for run in runs for method in FRAME_METHODS for one in run.of(method)]
    known = [value for value in sharp if value is not None]
    return one_line(words.FRAME_DETECTOR, sharp=f"{min(known):.3f}") if known else one_line(words.NO_FRAME_DETECTOR)


def _accuracy(runs: Sequence[SeedRun]) -> ReportSection:
    forms = {
        "precision": ".3f", "recall": ".3f", "error_mean_px": ".2f", "error_median_px": ".2f", "error_p95_px": ".2f",
        "point_median_mm": ".2f", "point_p95_mm": ".1f", "hit_median_mm": ".1f", "hit_p95_mm": ".1f",
        "hits_told": ".2f",
    }  # fmt: skip
    columns = (
        "method", "precision", "recall", "error mean px", "median", "p95", "3D median mm", "p95",
        "hitting point median mm", "p95", "told",
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
        words.COMPARISONS,
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
        return words.NO_FRAMES
    exposure_ms = 1e-3 * mean([one.exposure_us for one in readings])
    return one_line(
        words.FRAMES,
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
    return ReportSection("The paper's four scenes with people", paragraphs(words.SCENES), columns, tuple(rows))


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
    text = paragraphs(words.LIMITS, read_ns=read_ns)
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
        "hitting point median mm", "bytes per detection", "hits told",
    )  # fmt: skip
    return ReportSection("Recording by recording", ("All seeds together.",), columns, tuple(rows))


def _definitions() -> ReportSection:
    delays = {"delay_ms": 1e-3 * SENSOR_DELAY_US, "readout_ms": 1e-3 * READOUT_US}
    return ReportSection("How it is measured", paragraphs(words.DEFINITIONS, event_bytes=EVENT_BYTES, **delays))


def _known(value: float, form: str) -> str:
    return "-" if math.isnan(value) else _number(value, form)
