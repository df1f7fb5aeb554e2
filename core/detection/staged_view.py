"""The trace of the staged pipeline as views, counts and a table of candidates, and why a window has no ball."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.config import DetectorConfig
from core.detection.method_trace import (
    NOISE,
    RAW,
    RESULT,
    CandidateRow,
    MethodTrace,
    Outline,
    PixelLayer,
    StageCount,
    View,
    region_shapes,
)
from core.detection.reasons import Reason
from core.detection.stage_trace import Candidate, PipelineTrace
from core.events import Window

VIEWS: Final = (RAW, "denoised", "clusters", "polarity", "geometry", RESULT)
"""The stages, as on their buttons."""
TITLES: Final = ("events", "leads", "circularity", "solidity", "radius [px]")
GROUPS: Final = ("window", "denoise", "cluster", "polarity", "geometry", "localise")
"""The section of sliders of each view."""
AFTER: Final = ("cluster", "polarity", "geometry", "localise")
"""Stages that reject candidates, in order."""
REJECTED_IN: Final = {
    RAW: (),
    "denoised": (),
    "clusters": AFTER[:1],
    "polarity": AFTER[:2],
    "geometry": AFTER,
    RESULT: AFTER,
}
"""Stages whose rejected candidates each view shows."""
LABELLED: Final = 12
"""Number of largest clusters with figures: the picture of a person may have a hundred clusters."""


def view_of(trace: PipelineTrace, window: Window, config: DetectorConfig) -> MethodTrace:
    """Everything that is shown of a trace."""
    roi = trace.roi
    middle = None if roi is None else ((roi.x_min + roi.x_max) / 2, (roi.y_min + roi.y_max) / 2)
    return MethodTrace(
        views=tuple(_view(trace, name, group) for name, group in zip(VIEWS, GROUPS, strict=True)),
        counts={one.name: StageCount(one.count_in, one.count_out, seconds=one.seconds) for one in trace.stages},
        noun="cluster",
        titles=TITLES,
        candidates=tuple(map(_row, trace.candidates)),
        detection=trace.detection,
        reasons=() if trace.detection is not None else reasons_without_ball(trace, len(window.events), config),
        where="searched in the ROI" if roi else "searched on the whole sensor",
        centre_px=middle,
    )


def reasons_without_ball(trace: PipelineTrace, events: int, config: DetectorConfig) -> tuple[Reason, ...]:
    """Limits that the cluster failed that came farthest through the stages, of several the largest.

    Without a cluster the stage after which nothing was left.
    """
    if trace.candidates:
        best = max(trace.candidates, key=lambda one: (AFTER.index(one.rejected_by or AFTER[-1]), one.size))
        return best.reasons
    least = config.cluster.size_min
    if events < least:
        return (Reason("events in the window", "window.window_us", events, least),)
    seen, clean = trace.stage("roi").count_out, trace.stage("denoise").count_out
    if seen < least:
        return (Reason("events in the region", "roi.roi_expand_px", seen, least),)
    if clean < least:
        return (Reason("events left by denoising", "denoise.kernel_px", clean, least),)
    return (Reason("clusters", "cluster.eps_px", 0, 1),)


def _view(trace: PipelineTrace, name: str, group: str) -> View:
    shapes = (*_outlines(trace, name), *region_shapes(trace.roi))
    return View(name, group, None if name in (RAW, RESULT) else _pixels(trace, name), shapes)


def _pixels(trace: PipelineTrace, name: str) -> PixelLayer:
    denoised = trace.stage("denoise").events
    if name == "denoised":
        return PixelLayer.of_events(denoised)
    if name == "clusters":
        return PixelLayer.of_events(denoised, np.where(trace.labels >= 0, trace.labels, NOISE))
    if name == "polarity":
        return PixelLayer.joined([PixelLayer.of_events(one.leading_events) for one in trace.candidates])
    return PixelLayer.joined([PixelLayer.of_events(one.leading_events, one.label) for one in trace.candidates])


def rejected_up_to(trace: PipelineTrace, name: str) -> tuple[Candidate, ...]:
    """Clusters that a view shows as rejected, by its stage or an earlier one; in the result if there is no ball."""
    stages = () if name == RESULT and trace.detection is not None else REJECTED_IN[name]
    return tuple(one for one in trace.candidates if one.rejected_by in stages)


def _outlines(trace: PipelineTrace, name: str) -> list[Outline]:
    """The rejected clusters of a view, and the hulls of the others; the largest ones with their figures."""
    lost, found = rejected_up_to(trace, name), []
    largest = sorted(trace.candidates, key=lambda one: -one.size)[:LABELLED]
    for one in trace.candidates:
        text = _figures(one, name, one in lost) if one in largest else ""
        place = (float(one.events.x_px.max()) + 2, float(one.events.y_px.min()) - 1)
        if one in lost:
            found.append(Outline("rejected", _outline(one), text=text, text_px=place))
        elif name == "geometry" and one.shape is not None and len(one.shape.hull_px) > 1:
            found.append(Outline("accepted", one.shape.hull_px, text=text, text_px=place))
        elif text:
            found.append(Outline("accepted", np.zeros((0, 2)), text=text, text_px=place))
    return found


def _outline(candidate: Candidate) -> NDArray[np.float64]:
    """Corners of the measured hull; without one, of a box around the events (4, 2)."""
    if candidate.shape is not None and len(candidate.shape.hull_px) > 1:
        return candidate.shape.hull_px
    xs, ys = candidate.events.x_px, candidate.events.y_px
    x0, x1, y0, y1 = xs.min() - 0.5, xs.max() + 0.5, ys.min() - 0.5, ys.max() + 0.5
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def _figures(candidate: Candidate, name: str, lost: bool) -> str:
    """Text beside a cluster: why it was rejected, else what its stage measured."""
    if lost:
        return f"{candidate.label}: {candidate.rejected}"
    if name not in ("clusters", "geometry"):
        return ""
    if name == "clusters" or candidate.shape is None:
        return f"{candidate.label}: {candidate.size} events"
    return f"{candidate.label}: circularity {candidate.shape.circularity:.2f}, solidity {candidate.shape.solidity:.2f}"


def _row(candidate: Candidate) -> CandidateRow:
    shape, circle = candidate.shape, candidate.circle
    return CandidateRow(
        label=candidate.label,
        figures=(
            str(candidate.size), "ON" if candidate.leading_on else "OFF",
            f"{shape.circularity:.2f}" if shape else "-", f"{shape.solidity:.2f}" if shape else "-",
            f"{circle.r_px:.1f}" if circle else "-",
        ),
        reasons=candidate.reasons,
        verdict="ball",
        order=candidate.size,
        x_px=candidate.events.x_px,
        y_px=candidate.events.y_px,
    )  # fmt: skip
