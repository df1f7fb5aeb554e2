"""Small live pictures of the cameras: events of the last milliseconds, detected circle, true circle."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from app.pictures.canvas import Canvas, Rendering, encode_png, event_picture
from app.pictures.palette import PaletteIndex
from app.state.client_state import RenderSettings
from app.views.requests import draw_ball_inset, window_before
from app.views.stage_picture import draw_truth
from core.events import Window
from core.recordings import Recording

WIDTH_PX = 640
"""Pictures are binned to at most this width."""
MANY_WIDTH_PX = 320
"""Width where three or more share the rows of the panel."""

LEAST_RADIUS_PX = 6
"""Smallest circle that is drawn, in pixels of the picture: in a small one the ball itself is hardly seen."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraPicturesRequest:
    """All cameras at one time."""

    recording: Recording
    t_us: int
    look: RenderSettings
    circles: dict[str, tuple[float, float, float]]
    """u, v, r of the detected circle, px, by camera."""
    show_truth: bool
    used: frozenset[str] = frozenset()
    """The cameras that the ball's position is made of; empty if it is not known."""

    @property
    def key(self) -> Hashable:
        """Cache key, equal for the same pictures. The missing end of a live recording may still arrive."""
        there_us = min(self.t_us, self.recording.duration_us)
        circles = tuple(sorted(self.circles.items()))
        return self.recording, self.t_us, there_us, self.look, circles, self.show_truth, self.used

    def is_outlier(self, camera: str) -> bool:
        """Whether what a camera found is not where the others see the ball."""
        return bool(self.used) and camera in self.circles and camera not in self.used


def _draw_inset(
    canvas: Canvas, window: Window, ball: tuple[float, float, float], ink: int, rendering: Rendering
) -> None:
    draw_ball_inset(
        canvas, window, ball, rendering, lambda inset: inset.draw_circle(*ball, ink, thickness=3), titled=False
    )


def render_camera_pictures(request: CameraPicturesRequest) -> dict[str, bytes]:
    """Draw each camera's picture as PNG, by camera."""
    pngs: dict[str, bytes] = {}
    width_px = WIDTH_PX if len(request.recording.cameras) < 3 else MANY_WIDTH_PX
    for name, stream in request.recording.cameras.items():
        window = window_before(stream, request.t_us, request.look.window_us)
        binning = max(1, -(-stream.sensor.width_px // width_px))
        pixels = event_picture(window, request.look.rendering, binning=binning)
        canvas = Canvas.of_binned(pixels, stream.sensor, binning, across=2)
        if request.show_truth:
            draw_truth(canvas, stream.truth, window.end_us)
        if name in request.circles:
            ink = PaletteIndex.HULL_REJECTED if request.is_outlier(name) else PaletteIndex.CIRCLE
            u_px, v_px, r_px = request.circles[name]
            canvas.draw_circle(u_px, v_px, max(r_px, LEAST_RADIUS_PX / canvas.scale), ink)
            if request.look.magnifies_ball:
                _draw_inset(canvas, window, request.circles[name], ink, request.look.rendering)
        pngs[name] = encode_png(canvas.image, request.look.colours)
    return pngs
