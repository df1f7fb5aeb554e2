"""What an export is computed with, in words: the detector's config, and the labels that are left out."""

from __future__ import annotations

from typing import Final

from app import theme
from app.formatting.file_text import html_text
from app.modes.export.plan_panel import ExportPlan
from app.state.settings_text import default_config
from core.detection.saved import SavedDetector

COMPUTED: Final = frozenset({"rrd", "html", "viser", "mp4", "png"})
"""Formats with what the chain finds in the events; the others hold what was recorded."""


def made_with_html(plan: ExportPlan, detector: SavedDetector, annotators: tuple[str, ...]) -> str:
    """Lines about an export of a recording; empty for a training run and for what the browser draws."""
    if plan.what != "Recording" or plan.of_view:
        return ""
    lines = [detector_text(detector) if plan.format in COMPUTED else "As recorded: no detector is run for this format."]
    left_out = labels_left_out(plan, annotators)
    if left_out:
        lines.append(f"Left out: the labels of {html_text(', '.join(left_out))}.")
    return f"<div style='padding:2px 1em;font-size:12.5px;color:{theme.MUTED}'>{'<br>'.join(lines)}</div>"


def detector_text(detector: SavedDetector) -> str:
    """Which settings detections and predictions are made with."""
    changed = "as it comes" if detector.config == default_config(detector.method) else "changed in Tune"
    return f"Detections and predictions: method {detector.method} with Tune's config A, {changed}."


def labels_left_out(plan: ExportPlan, annotators: tuple[str, ...]) -> tuple[str, ...]:
    """The annotators whose labels are not in the file: only a Rerun file has labels, and those of one."""
    return tuple(name for name in annotators if plan.format != "rrd" or name != plan.annotator)
