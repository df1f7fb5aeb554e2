"""Drawing of a stage of any method, or of its answer alone, over the window's events."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.pictures.canvas import Canvas, Rendering, event_picture
from app.pictures.palette import CLUSTER_COLOURS, PaletteIndex
from core.detection import Detection, RefinedDetection
from core.detection.method_trace import (
    INSIDE,
    LEADING,
    NOISE,
    OFF,
    ON,
    OUTLIER,
    TRAILING,
    MethodTrace,
    Outline,
    Role,
)
from core.events import Window, polarity_image
from core.metrics.run import WindowAnswer
from core.recordings import PixelTruth

KIND_INK: Final = {
    OFF: PaletteIndex.OFF,
    ON: PaletteIndex.ON,
    NOISE: PaletteIndex.NOISE,
    LEADING: PaletteIndex.HULL,
    TRAILING: PaletteIndex.TRUTH,
    INSIDE: PaletteIndex.DRAFT,
    OUTLIER: PaletteIndex.HULL_REJECTED,
}
"""Colours of what is not of a candidate."""
ROLE_INK: Final[dict[Role, int]] = {
    "accepted": PaletteIndex.HULL,
    "rejected": PaletteIndex.HULL_REJECTED,
    "waiting": PaletteIndex.NO_BALL,
    "region": PaletteIndex.ROI,
}
VELOCITY_MS = 10.0
"""The line from a ball's centre is the way it goes in this time: longer than its radius, unless it is slow."""
LATE_US: Final = 2_000
"""An answer that is valid longer before the end of the shown window is broken and says by how much: the ball, and the
events that are drawn last, have moved on since."""
DOT_PX: Final = 1
"""Half the side of a point between pixels, in pixels of the picture."""


def draw_stage(
    canvas: Canvas, window: Window, trace: MethodTrace, name: str, rendering: Rendering, *, wrong: bool = False
) -> None:
    """Paint the events as a stage sees them, then the shapes that belong to it, and the ball; a `wrong` one in red."""
    view = trace.view(name)
    canvas.paint_pixels(stage_pixels(window, trace, name, rendering))
    for shape in view.shapes:
        _draw_shape(canvas, shape)
    for ink in np.unique(view.dot_kinds).tolist():
        canvas.draw_dots(view.dots_px[view.dot_kinds == ink], KIND_INK[ink], half_px=DOT_PX)
    if trace.detection is not None and view.shows_ball:
        ink = ball_ink(wrong=wrong)
        draw_detection(canvas, trace.detection, window.end_us, ink)
        draw_velocity(canvas, trace.detection, ink)
    for shape in view.shapes:
        if shape.text:
            canvas.write(*shape.text_px, shape.text, PaletteIndex.TEXT)


def _draw_shape(canvas: Canvas, shape: Outline) -> None:
    ink = ROLE_INK[shape.role]
    thickness = 2 if shape.role == "rejected" and canvas.scale >= 2 else 1
    if shape.radius_px is not None:
        ((u, v),) = shape.points_px.tolist()
        canvas.draw_circle(u, v, shape.radius_px, ink, thickness=thickness)
    elif len(shape.points_px):
        canvas.draw_polygon(shape.points_px, ink, thickness=thickness, closed=len(shape.points_px) > 2)


def draw_velocity(canvas: Canvas, ball: Detection, ink: int = PaletteIndex.CIRCLE) -> None:
    """Draw which way a ball goes, if its method says so."""
    if isinstance(ball, RefinedDetection):
        ahead = (ball.u_px + VELOCITY_MS * ball.vu_px_per_ms, ball.v_px + VELOCITY_MS * ball.vv_px_per_ms)
        canvas.draw_polygon([(ball.u_px, ball.v_px), ahead], ink, thickness=2, closed=False)


def draw_answer(canvas: Canvas, answer: WindowAnswer, rendering: Rendering, ink: int = PaletteIndex.CIRCLE) -> None:
    """Draw a window's events, the detected ball, and its velocity if the method gives one."""
    canvas.paint_pixels(event_picture(answer.window, rendering))
    ball = answer.detection
    if ball is None:
        return
    draw_detection(canvas, ball, answer.window.end_us, ink)
    draw_velocity(canvas, ball, ink)


def ball_ink(*, wrong: bool) -> PaletteIndex:
    """Colour of a found ball's circle: red where it is `wrong`."""
    return PaletteIndex.HULL_REJECTED if wrong else PaletteIndex.CIRCLE


def draw_detection(canvas: Canvas, detection: Detection, end_us: int, ink: int = PaletteIndex.CIRCLE) -> None:
    """Draw the circle of a detected ball where it was when the answer is valid, over events up to `end_us`."""
    thickness = 2 if canvas.scale >= 1 else 1  # in a binned picture a ball is only a few pixels wide
    u, v, r = detection.u_px, detection.v_px, detection.r_px
    late_us = end_us - detection.t_us
    if late_us <= LATE_US:
        canvas.draw_circle(u, v, r, ink, thickness=thickness)
        return
    canvas.draw_broken_ring(u, v, max(1, round(r * canvas.scale)), ink, thickness=thickness)
    canvas.write(u + r, v + r, f"{late_us / 1e3:.1f} ms earlier", ink)


def miss_px(detection: Detection | None, truth: PixelTruth | None) -> float | None:
    """Distance of an answer from the true ball at the answer's own time, px.

    Infinite where there is no ball then; None without an answer, or where the truth is not known.
    """
    if detection is None or truth is None or not len(truth.t_us):
        return None
    if not truth.t_us[0] <= detection.t_us <= truth.t_us[-1]:
        return None
    there = truth.at(detection.t_us)
    if not there.visible[0]:
        return math.inf
    return math.hypot(detection.u_px - float(there.u_px[0]), detection.v_px - float(there.v_px[0]))


def draw_truth(canvas: Canvas, truth: PixelTruth | None, t_us: int) -> None:
    """Draw the true outline at one time, if the recording has it."""
    if truth is not None:
        now = truth.at(t_us)
        if now.visible[0]:
            canvas.draw_circle(float(now.u_px[0]), float(now.v_px[0]), float(now.r_px[0]), PaletteIndex.TRUTH)


def cluster_colour_index(label: int) -> int:
    """The colour of a cluster; neighbours in number differ."""
    return PaletteIndex.CLUSTER + label % CLUSTER_COLOURS


def stage_pixels(window: Window, trace: MethodTrace, name: str, rendering: Rendering) -> NDArray[np.uint8]:
    """(H, W) palette indices of a stage's pixels over the dimmed events of the window."""
    layer = trace.view(name).pixels
    if layer is None:
        return event_picture(window, rendering)
    raw = polarity_image(window.events)
    pixels = np.where(raw > 0, raw + (PaletteIndex.OFF_DIM - PaletteIndex.OFF), raw).astype(np.uint8)
    inks = (PaletteIndex.CLUSTER + layer.kind % CLUSTER_COLOURS).astype(np.uint8)
    for kind, ink in KIND_INK.items():
        inks[layer.kind == kind] = ink
    height, width = pixels.shape
    seen = (layer.x_px >= 0) & (layer.x_px < width) & (layer.y_px >= 0) & (layer.y_px < height)
    pixels[layer.y_px[seen], layer.x_px[seen]] = inks[seen]
    return pixels
