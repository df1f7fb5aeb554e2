"""Drawing of each stage of the detector, or of an answer without stages, over the window's events."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.pictures.canvas import Canvas, Rendering, event_picture
from app.pictures.palette import CLUSTER_COLOURS, PaletteIndex
from app.state.client_state import Overlay
from core.detection import Candidate, Detection, PipelineTrace, RefinedDetection
from core.events import Events, Window, polarity_image
from core.metrics.run import WindowAnswer
from core.recordings import PixelTruth

LABELLED_CANDIDATES = 12
"""Number of largest clusters with figures: the picture of a person may have a hundred clusters."""

_AFTER_ALL = ("cluster", "polarity", "geometry", "localise")
REJECTED_IN: Final[dict[Overlay, tuple[str, ...]]] = {
    "raw": (),
    "denoised": (),
    "clusters": _AFTER_ALL[:1],
    "polarity": _AFTER_ALL[:2],
    "geometry": _AFTER_ALL,
    "result": _AFTER_ALL,
}
"""Stages whose rejected clusters each view shows."""

VELOCITY_MS = 10.0
"""The line from a ball's centre is the way it goes in this time: longer than its radius, unless it is slow."""


def draw_stages(canvas: Canvas, window: Window, trace: PipelineTrace, overlay: Overlay, rendering: Rendering) -> None:
    """Paint the events as the chosen stage sees them, then the shapes that belong to it."""
    canvas.paint_pixels(_pixels(window, trace, overlay, rendering))
    lost = rejected_up_to(trace, overlay)
    for candidate in trace.candidates:
        if candidate in lost:
            canvas.draw_polygon(
                _outline(candidate), PaletteIndex.HULL_REJECTED, thickness=2 if canvas.scale >= 2 else 1
            )
        elif overlay == "geometry" and candidate.shape is not None and len(candidate.shape.hull_px) > 1:
            canvas.draw_polygon(candidate.shape.hull_px, PaletteIndex.HULL)
    if trace.roi is not None:
        roi = trace.roi
        canvas.draw_box(roi.x_min - 0.5, roi.y_min - 0.5, roi.x_max + 0.5, roi.y_max + 0.5, PaletteIndex.ROI)
    if trace.detection is not None:
        draw_detection(canvas, trace.detection)
    for candidate in sorted(trace.candidates, key=lambda one: -one.size)[:LABELLED_CANDIDATES]:
        xs, ys = candidate.events.x_px, candidate.events.y_px
        if text := _figures(candidate, overlay, candidate in lost):
            canvas.write(float(xs.max()) + 2, float(ys.min()) - 1, text, PaletteIndex.TEXT)


def rejected_up_to(trace: PipelineTrace, overlay: Overlay) -> tuple[Candidate, ...]:
    """Clusters that a view shows as rejected, by its stage or an earlier one; in the result if there is no ball."""
    stages = REJECTED_IN[overlay]
    if overlay == "result" and trace.detection is not None:
        stages = ()
    return tuple(one for one in trace.candidates if one.rejected_by in stages)


def draw_answer(canvas: Canvas, answer: WindowAnswer, rendering: Rendering, ink: int = PaletteIndex.CIRCLE) -> None:
    """Draw a window's events, the detected ball, and its velocity if the method gives one."""
    canvas.paint_pixels(event_picture(answer.window, rendering))
    ball = answer.detection
    if ball is None:
        return
    draw_detection(canvas, ball, ink)
    if isinstance(ball, RefinedDetection):
        ahead = (ball.u_px + VELOCITY_MS * ball.vu_px_per_ms, ball.v_px + VELOCITY_MS * ball.vv_px_per_ms)
        canvas.draw_polygon([(ball.u_px, ball.v_px), ahead], ink, thickness=2, closed=False)


def draw_detection(canvas: Canvas, detection: Detection, ink: int = PaletteIndex.CIRCLE) -> None:
    """Draw the circle of a detected ball."""
    thickness = 2 if canvas.scale >= 1 else 1  # in a binned picture a ball is only a few pixels wide
    canvas.draw_circle(detection.u_px, detection.v_px, detection.r_px, ink, thickness=thickness)


def draw_truth(canvas: Canvas, truth: PixelTruth | None, t_us: int) -> None:
    """Draw the true outline at one time, if the recording has it."""
    if truth is not None:
        now = truth.at(t_us)
        if now.visible[0]:
            canvas.draw_circle(float(now.u_px[0]), float(now.v_px[0]), float(now.r_px[0]), PaletteIndex.TRUTH)


def cluster_colour_index(label: int) -> int:
    """The colour of a cluster; neighbours in number differ."""
    return PaletteIndex.CLUSTER + label % CLUSTER_COLOURS


def _pixels(window: Window, trace: PipelineTrace, overlay: Overlay, rendering: Rendering) -> NDArray[np.uint8]:
    if overlay in ("raw", "result"):
        return event_picture(window, rendering)
    raw = polarity_image(window.events)
    pixels = np.where(raw > 0, raw + (PaletteIndex.OFF_DIM - PaletteIndex.OFF), raw).astype(np.uint8)
    denoised = trace.stage("denoise").events
    if overlay == "denoised":
        _paint_polarity(pixels, denoised)
    elif overlay == "clusters":
        inks = np.where(trace.labels >= 0, PaletteIndex.CLUSTER + trace.labels % CLUSTER_COLOURS, PaletteIndex.NOISE)
        pixels[denoised.y_px, denoised.x_px] = inks
    elif overlay == "polarity":
        for candidate in trace.candidates:
            _paint_polarity(pixels, candidate.leading_events)
    else:
        for candidate in trace.candidates:
            events = candidate.leading_events
            pixels[events.y_px, events.x_px] = cluster_colour_index(candidate.label)
    return pixels


def _paint_polarity(pixels: NDArray[np.uint8], events: Events) -> None:
    pixels[events.y_px, events.x_px] = np.where(events.on, PaletteIndex.ON, PaletteIndex.OFF)


def _outline(candidate: Candidate) -> NDArray[np.float64]:
    """Corners of the measured hull; without one, of a box around the events (4, 2)."""
    if candidate.shape is not None and len(candidate.shape.hull_px) > 1:
        return candidate.shape.hull_px
    xs, ys = candidate.events.x_px, candidate.events.y_px
    x0, x1, y0, y1 = xs.min() - 0.5, xs.max() + 0.5, ys.min() - 0.5, ys.max() + 0.5
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def _figures(candidate: Candidate, overlay: Overlay, lost: bool) -> str:
    """Text beside a cluster: why it was rejected, else what its stage measured."""
    if lost:
        return f"{candidate.label}: {candidate.rejected}"
    if overlay not in ("clusters", "geometry"):
        return ""
    if overlay == "clusters" or candidate.shape is None:
        return f"{candidate.label}: {candidate.size} ev"
    return f"{candidate.label}: c {candidate.shape.circularity:.2f} s {candidate.shape.solidity:.2f}"
