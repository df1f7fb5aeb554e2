"""What an export is computed with, in words: the detector's config, and the labels that are left out."""

from __future__ import annotations

from app import theme
from app.export.formats import FORMATS
from app.formatting.file_text import html_text
from app.modes.export.plan_panel import ExportPlan
from core.detection import DetectorConfig


def made_with_html(plan: ExportPlan, config: DetectorConfig, annotators: tuple[str, ...]) -> str:
    """Lines about an export of a recording; empty for a training run and for what the browser draws."""
    if plan.what != "Recording" or plan.of_view:
        return ""
    lines = [
        detector_text(config) if FORMATS[plan.format].computed else "As recorded: no detector is run for this format."
    ]
    left_out = labels_left_out(plan, annotators)
    if left_out:
        lines.append(f"Left out: the labels of {html_text(', '.join(left_out))}.")
    return f"<div style='padding:2px 1em;font-size:12.5px;color:{theme.MUTED}'>{'<br>'.join(lines)}</div>"


def detector_text(config: DetectorConfig) -> str:
    """Which settings detections and predictions are made with."""
    changed = "as it comes" if config == DetectorConfig() else "changed in Tune"
    return f"Detections and predictions: method auto with Tune's config A, {changed}."


def labels_left_out(plan: ExportPlan, annotators: tuple[str, ...]) -> tuple[str, ...]:
    """The annotators whose labels are not in the file: only a Rerun file has labels, and those of one."""
    return tuple(name for name in annotators if plan.format != "rrd" or name != plan.annotator)
