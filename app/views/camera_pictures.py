"""Small live pictures of the cameras: events of the last milliseconds, detected circle, true circle; and the picture of
a frame camera full size.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2

from app.pictures.canvas import Canvas, Region, Rendering, encode_png, event_picture
from app.pictures.palette import PaletteIndex
from app.state.client_state import RenderSettings
from app.views.ball_inset import draw_ball_inset
from app.views.frame_picture import NO_PICTURE, frame_size, frame_title, picture_or_blank, whole_frame
from app.views.mosaic import Mosaic, lay_out
from app.views.requests import window_before
from app.views.stage_picture import draw_truth
from core.chain.follow import frame_cameras
from core.events import Window
from core.history.rally_history import RallyHistory, RallyStep
from core.recordings import Recording
from core.recordings.frames import FrameStream

WIDTH_PX = 640
"""Pictures are binned to at most this width."""
MANY_WIDTH_PX = 320
"""Width where three or more share the rows of the panel."""

LEAST_RADIUS_PX = 6
"""Smallest circle that is drawn, in pixels of the picture: in a small one the ball itself is hardly seen."""


class FrameSighting(NamedTuple):
    """The newest picture of a frame camera, and what was found in it."""

    number: int
    """`NO_PICTURE` before the first."""
    circle: tuple[float, float, float] | None
    """u, v, r, px."""
    used: bool
    """Whether it tells where the ball is."""


def frame_sightings(history: RallyHistory, frames: Mapping[str, FrameStream], t_us: int) -> dict[str, FrameSighting]:
    """The newest picture of each frame camera that was over at a time."""
    found: dict[str, FrameSighting] = {}
    for name, one in frames.items():
        number = one.newest(t_us)
        if number == NO_PICTURE:  # it has its place from the beginning: pictures that come later would move the others
            found[name] = FrameSighting(NO_PICTURE, None, False)
            continue
        # The chain has looked at it in the first step that ends after its exposure.
        step = next(iter(history.steps_between(int(one.ends_us[number - one.first]) - 1, t_us)), None)
        circle = None if step is None else step.circles.get(name)
        found[name] = FrameSighting(number, circle, step is not None and name in step.used)
    return found


def with_frames(step: RallyStep, seen: Mapping[str, FrameSighting]) -> RallyStep:
    """The step with what was found in the newest pictures: each stands for longer than a step, until the next one."""
    circles = {name: circle for name, circle in step.circles.items() if name not in seen}
    circles |= {name: one.circle for name, one in seen.items() if one.circle is not None}
    used = frozenset(name for name in step.used if name not in seen)
    used |= {name for name, one in seen.items() if one.used}
    return replace(step, circles=circles, used=used)


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
    frames: tuple[tuple[str, int], ...] = ()
    """Frame cameras, each with the number of its picture or `NO_PICTURE`, which stand behind the event cameras."""
    reached: bool = True
    """Whether the chain has come to this time: before, nobody knows who sees the ball."""

    @property
    def key(self) -> Hashable:
        """Cache key, equal for the same pictures. The missing end of a live recording may still arrive."""
        there_us = min(self.t_us, self.recording.duration_us)
        circles = tuple(sorted(self.circles.items()))
        seen = circles, self.show_truth, self.used, self.frames, self.reached
        return self.recording, self.t_us, there_us, self.look, seen

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
    width_px = WIDTH_PX if len(request.recording.cameras) + len(request.frames) < 3 else MANY_WIDTH_PX
    for name, stream in request.recording.cameras.items():
        window = window_before(stream, request.t_us, request.look.window_us)
        binning = max(1, -(-stream.sensor.width_px // width_px))
        pixels = event_picture(window, request.look.rendering, binning=binning)
        canvas = Canvas.of_binned(pixels, stream.sensor, binning, across=2)
        if request.show_truth:
            draw_truth(canvas, stream.truth, window.end_us)
        ink = _draw_circle(canvas, request, name)
        if ink is not None and request.look.magnifies_ball:
            _draw_inset(canvas, window, request.circles[name], ink, request.look.rendering)
        pngs[name] = encode_png(canvas.image, request.look.colours)
    streams = frame_cameras(request.recording) if request.frames else {}
    for name, number in request.frames:
        pngs[name] = _frame_png(streams[name], number, request, name, width_px)
    return pngs


class LargeFrameRequest(NamedTuple):
    """The newest picture of one frame camera, full size."""

    camera: str
    pictures: CameraPicturesRequest
    """Has it among its `frames`."""

    @property
    def key(self) -> Hashable:
        """Equal for the same picture: at most times it is the one that was shown before."""
        asked, name = self.pictures, self.camera
        number = dict(asked.frames)[name]
        return asked.recording.uuid, name, number, asked.circles.get(name), asked.is_outlier(name), asked.look


def render_large_frame(request: LargeFrameRequest) -> Mosaic:
    """Draw a picture of a frame camera in its own colours, with what the chain found in it and when it was taken."""
    name, pictures = request
    stream, number = frame_cameras(pictures.recording)[name], dict(pictures.frames)[name]
    image = picture_or_blank(stream, number)
    canvas = Canvas(Region.of_sensor(frame_size(image)))
    canvas.image[:] = PaletteIndex.BACKGROUND
    canvas.caption(frame_title(name, stream, number))
    if number != NO_PICTURE:
        canvas.paint_frame(image)
        _draw_circle(canvas, pictures, name, thickness=2)
    return lay_out([canvas], pictures.look.colours, "side by side")


def _draw_circle(canvas: Canvas, request: CameraPicturesRequest, name: str, *, thickness: int = 1) -> int | None:
    """Draw what was found in a camera; returns its palette index, None if nothing was."""
    if name not in request.circles:
        return None
    ink = PaletteIndex.HULL_REJECTED if request.is_outlier(name) else PaletteIndex.CIRCLE
    u_px, v_px, r_px = request.circles[name]
    canvas.draw_circle(u_px, v_px, max(r_px, LEAST_RADIUS_PX / canvas.scale), ink, thickness=thickness)
    return ink


def _frame_png(stream: FrameStream, number: int, request: CameraPicturesRequest, name: str, width_px: int) -> bytes:
    """A picture in its own colours, with its circle."""
    canvas = whole_frame(picture_or_blank(stream, number), width_px)
    if number == NO_PICTURE:
        left_middle = canvas.image.shape[1] // 12, canvas.image.shape[0] // 2
        cv2.putText(canvas.image, "no picture yet", left_middle, cv2.FONT_HERSHEY_SIMPLEX, 1.0, int(PaletteIndex.TEXT))
        return encode_png(canvas.image, request.look.colours)
    _draw_circle(canvas, request, name)
    return canvas.encode(request.look.colours)
