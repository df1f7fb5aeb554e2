"""Frozen picture requests of a browser, and the pure functions that answer them with a mosaic."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from app.pictures.canvas import Canvas, Region, event_picture
from app.pictures.palette import PaletteIndex
from app.state.client_state import RenderSettings, TuneView
from app.state.swept_cells import SweptCells, TableClicks
from app.views.answer_cache import AnswerCache
from app.views.ball_inset import draw_ball_inset
from app.views.frame_picture import OF_EVENT_CAMERA, frame_size, frame_title, newest_frame, shown_frames, whole_frame
from app.views.mosaic import Mosaic, columns_of, columns_that_fill, lay_out, lay_out_grid
from app.views.space_time import SpaceTime, answers_around, space_time_of
from app.views.stage_picture import ball_ink, draw_detection, draw_stage, draw_truth, miss_px
from core.cameras import Camera
from core.cameras.calibration.coverage import cell_box, cells_of
from core.cameras.calibration.table_corners import CORNERS
from core.cameras.calibration.table_pose import clicks_of, find_table_pose
from core.detection import DetectorConfig
from core.detection.saved import SavedDetector
from core.errors import CalibrationError
from core.events import Window
from core.metrics.playback import PlaybackAnswers
from core.metrics.run import WindowAnswer, answer_window
from core.metrics.score import MATCH_RADIUS_PX
from core.recordings import CameraStream, PixelTruth, Recording
from core.recordings.frames import FrameStream
from core.text import counted

RADIUS_PX = 8
OUTLINE = ("robot-left", "robot-right", "opponent-right", "opponent-left")
NET = ("net-left", "post-left", "post-right", "net-right")
EDGE_POINTS = 24
"""Points per edge of an outline: a lens bends lines."""


def draw_table_clicks(canvas: Canvas, name: str, lens: Camera | None, clicks: TableClicks) -> None:
    """Draw the clicked corners with their numbers and, once they determine a pose, table and net."""
    marks = [mark for mark in clicks.marks if mark.camera == name]
    if lens is not None and marks:
        try:
            pose = find_table_pose(name, lens, clicks_of(clicks.of(name)))
        except CalibrationError:
            pass  # the panel shows the reason
        else:
            for corners, closed in ((OUTLINE, True), (NET, False)):
                points = pose.camera.project(_edges(corners, closed=closed))
                if np.isfinite(points).all():
                    canvas.draw_polygon(points, PaletteIndex.EPIPOLAR, closed=closed)
    for mark in marks:
        canvas.draw_broken_ring(
            mark.u_px, mark.v_px, RADIUS_PX * canvas.across, PaletteIndex.LABEL, thickness=canvas.across
        )
        away = 1.4 * RADIUS_PX * canvas.across / canvas.scale
        canvas.write(mark.u_px + away, mark.v_px - away / 2, str(mark.number), PaletteIndex.LABEL)


def _edges(corners: tuple[str, ...], *, closed: bool) -> np.ndarray:
    """(N, 3) points along the lines from corner to corner."""
    ps = np.array([CORNERS[corner] for corner in corners])
    ends = np.vstack([ps, ps[:1]]) if closed else ps
    share = np.linspace(0, 1, EDGE_POINTS)[:, None]
    return np.vstack([a + share * (b - a) for a, b in pairwise(ends)])


NO_SHEET = Mosaic((), 16, 9)
CELL_GAP_PX = 10
"""Gap between the frames of uncovered cells."""
BINNED_WIDTH_PX = 900
"""Sensors wider than this are binned two by two where several pictures share the window: single events stay visible."""


@dataclass(frozen=True, slots=True, eq=False)
class WatchRequest:
    """Request for all cameras of a recording at one time."""

    recording: Recording
    t_us: int
    look: RenderSettings
    detector: SavedDetector
    """Detector whose circle is drawn."""
    show_truth: bool
    large: str = ""
    """The only camera to show; all if empty or unknown."""
    table: TableClicks = field(default_factory=TableClicks)
    """Clicked corners of the table."""
    swept: SweptCells = field(default_factory=SweptCells)
    """Coverage of the ball."""
    aspect: float | None = None
    """Width over height of what the window leaves to all pictures, which an automatic arrangement fills; None: it puts
    them side by side."""
    playback: PlaybackAnswers | None = None
    """What the pictures of a playback go on from; None: the answers depend on the 60 ms before `t_us` alone."""
    with_frames: bool = False
    """Whether those of ordinary cameras stand behind all event cameras, unless corners are clicked or a guide is on."""
    why_not: bool = False
    """Whether a picture without a ball says why, in the words of Tune."""


@dataclass(frozen=True, slots=True, eq=False)
class TuneRequest:
    """Request for one window of one camera with one or two configs of the method in `view`."""

    stream: CameraStream
    t_us: int
    look: RenderSettings
    view: TuneView
    configs: tuple[tuple[str, DetectorConfig], ...]
    """Name and config of each picture."""
    answers: AnswerCache
    """Cache of answers: each takes tens of windows to compute."""
    last_px: tuple[float, float] | None = None
    """Last position of the ball: a zoomed view stays there while a setting rejects it."""
    aspect: float | None = None
    """Width over height of what the window leaves to all pictures; a zoomed view fills it. None: the sensor's shape."""
    frames: FrameStream | None = None
    """Pictures of the ordinary camera that `view` shows beside the events; None: it shows none."""

    @property
    def tiles(self) -> int:
        """How many pictures share the window."""
        return len(self.configs) + (self.frames is not None)


@dataclass(frozen=True, slots=True, eq=False)
class PictureAnswer:
    """The mosaic to show, and the time it took."""

    sheet: Mosaic
    found: tuple[WindowAnswer, ...]
    """Answers of Tune with their traces, one for each config."""
    seconds: float
    misses_px: tuple[float | None, ...] = ()
    """`miss_px` of each answer, if the truth is shown; else empty."""
    space: SpaceTime | None = None
    """What is shown instead of the mosaic, which is empty then."""


def answer_request(request: WatchRequest | TuneRequest) -> PictureAnswer:
    """Answer a request."""
    start_s = time.perf_counter()
    if isinstance(request, WatchRequest):
        return PictureAnswer(render_watch(request), (), time.perf_counter() - start_s)
    if request.view.shows_space:
        space, answer = render_space(request)
        sheet, found = NO_SHEET, (answer,)
    else:
        space, (sheet, found) = None, render_tune(request)
    truth = request.stream.truth if request.view.show_truth else None
    misses_px = () if truth is None else tuple(miss_px(answer.detection, truth) for answer in found)
    return PictureAnswer(sheet, found, time.perf_counter() - start_s, misses_px, space)


def render_watch(request: WatchRequest) -> Mosaic:
    """Draw every camera's events with the detected ball, then the pictures of ordinary cameras."""
    look = request.look
    cameras = request.recording.cameras
    if request.large in cameras:
        cameras = {request.large: cameras[request.large]}
    of_events_only = request.large in cameras or request.table.active or request.swept.active
    frames = shown_frames(request.recording) if request.with_frames and not of_events_only else {}
    tiles = len(cameras) + len(frames)
    across = columns_of(tiles, look.arrangement)
    if look.arrangement == "automatic" and request.aspect is not None and cameras:
        sensor = next(iter(cameras.values())).sensor
        across = columns_that_fill(tiles, sensor.width_px / sensor.height_px, request.aspect)
    canvases: list[Canvas] = []
    balls: list[tuple[str, int]] = []
    for name, stream in cameras.items():
        window = window_before(stream, request.t_us, look.window_us)
        # Several wide pictures side by side are shown smaller than a pixel for a pixel anyway.
        binning = 2 if tiles > 1 and stream.sensor.width_px > BINNED_WIDTH_PX else 1
        if binning == 1:
            canvas = Canvas(Region.of_sensor(stream.sensor), across=across)
            canvas.paint_pixels(event_picture(window, look.rendering))
        else:
            pixels = event_picture(window, look.rendering, binning=binning)
            canvas = Canvas.of_binned(pixels, stream.sensor, binning, across=across)
        if request.playback is None:
            answer = answer_window(stream, *request.detector, window.end_us, why_not=request.why_not)
        else:
            answer = request.playback.find(stream, request.detector, window.end_us)
        detection = answer.detection
        if request.show_truth:
            draw_truth(canvas, stream.truth, answer.valid_us)
        if detection is not None:
            wrong = request.show_truth and is_wrong(miss_px(detection, stream.truth))
            ink = ball_ink(wrong=wrong)
            draw_detection(canvas, detection, window.end_us, ink)
            if look.magnifies_ball and not (request.table.active or request.swept.active):
                truth = stream.truth if request.show_truth else None
                _draw_inset(canvas, window, answer, truth, look, ink)
            balls.append((name, int(cells_of((detection.u_px, detection.v_px), stream.sensor)[0])))
        if request.swept.active:
            for cell in request.swept.missing(name):
                left, top, right, bottom = cell_box(cell, stream.sensor)
                canvas.draw_box(
                    left + CELL_GAP_PX,
                    top + CELL_GAP_PX,
                    right - CELL_GAP_PX,
                    bottom - CELL_GAP_PX,
                    PaletteIndex.NO_BALL,
                )
        draw_table_clicks(canvas, name, stream.calibration, request.table)
        canvas.caption(f"{name}: {counted(len(window.events), 'event')}")
        if answer.reasons:
            canvas.caption(f"{request.detector.method}: no ball", PaletteIndex.HULL_REJECTED)
            for reason in answer.reasons:
                canvas.caption(reason.text, PaletteIndex.HULL_REJECTED)
        canvases.append(canvas)
    for title, stream in frames.items():
        canvases.append(newest_frame(title, stream, request.t_us, canvases[0].image.shape[1], across=across))
    return replace(lay_out_grid(canvases, look.colours, across), ball_cells=tuple(balls))


def _draw_inset(
    canvas: Canvas, window: Window, answer: WindowAnswer, truth: PixelTruth | None, look: RenderSettings, ink: int
) -> None:
    """Draw the found ball magnified over a window's events, with the true circle at its time if `truth` is given."""
    ball = answer.detection
    if ball is None:
        return

    def draw_marks(inset: Canvas) -> None:
        draw_truth(inset, truth, answer.valid_us)
        draw_detection(inset, ball, window.end_us, ink)

    draw_ball_inset(canvas, window, (ball.u_px, ball.v_px, ball.r_px), look.rendering, draw_marks)


def render_tune(request: TuneRequest) -> tuple[Mosaic, tuple[WindowAnswer, ...]]:
    """Draw the chosen stage of one window, one picture per config, and beside them that of an ordinary camera.

    The truth is drawn where the ball was when the answer is valid, which is before the end of the window.
    """
    view = request.view
    across = request.tiles if request.look.arrangement != "stacked" else 1
    found = [request.answers.find(request.stream, view.method, config, request.t_us) for _, config in request.configs]
    region = _region(request, found[0], across)
    canvases: list[Canvas] = []
    for (name, _), answer in zip(request.configs, found, strict=True):
        canvas = Canvas(region, across=across)
        assert answer.trace is not None
        wrong = view.show_truth and is_wrong(miss_px(answer.detection, request.stream.truth))
        draw_stage(canvas, answer.window, answer.trace, view.stage, request.look.rendering, wrong=wrong)
        if view.show_truth:
            draw_truth(canvas, request.stream.truth, answer.valid_us)
        if view.zoom <= 1.0 and request.look.magnifies_ball and answer.detection is not None:
            truth = request.stream.truth if view.show_truth else None
            ink = ball_ink(wrong=wrong)
            _draw_inset(canvas, answer.window, answer, truth, request.look, ink)
        canvas.caption(f"{request.stream.name}, {view.method}, config {name}: {_when(answer, region)}")
        canvases.append(canvas)
    if request.frames is None:
        return lay_out(canvases, request.look.colours, request.look.arrangement), tuple(found)
    beside, is_other = _frame_canvas(request, request.frames, region, across)
    sheet = lay_out([*canvases, beside], request.look.colours, request.look.arrangement)
    tiles = (*sheet.pictures[:-1], replace(sheet.pictures[-1], is_other=is_other))
    return replace(sheet, pictures=tiles), tuple(found)


def _frame_canvas(request: TuneRequest, frames: FrameStream, region: Region, across: int) -> tuple[Canvas, bool]:
    """The picture nearest to the cursor, and whether it is of another sensor than the events.

    Through the lens of the event camera it shows the same region, with the ball where it was at mid exposure.
    """
    stream, title = request.stream, request.view.frames
    number = frames.nearest(request.t_us)
    image = frames.image(number)
    is_other = title != OF_EVENT_CAMERA.format(stream.name) or frame_size(image) != stream.sensor
    if is_other:
        canvas = whole_frame(image, across=across)
    else:
        canvas = Canvas(region, across=across)
        canvas.paint_frame(image)
        if request.view.show_truth:
            draw_truth(canvas, stream.truth, int(frames.t_us[number]))
    canvas.caption(frame_title(title, frames, number))
    return canvas, is_other


def render_space(request: TuneRequest) -> tuple[SpaceTime, WindowAnswer]:
    """Events of the first config's window and its neighbours in space and time, and the answer to that window."""
    view, stream = request.view, request.stream
    _, config = request.configs[0]
    answer = request.answers.find(stream, view.method, config, request.t_us)
    space = space_time_of(
        stream,
        answer,
        answers_around(stream, answer, config),
        _region(replace(request, aspect=None), answer, 1),
        view.stage,
        view.space_colour,
        request.look.colours,
        truth=stream.truth if view.show_truth else None,
        wrong=view.show_truth and is_wrong(miss_px(answer.detection, stream.truth)),
    )
    return space, answer


def is_wrong(distance_px: float | None) -> bool:
    """Whether an answer at this `miss_px` is no ball for scores and comparisons."""
    return distance_px is not None and distance_px > MATCH_RADIUS_PX


def _when(answer: WindowAnswer, region: Region) -> str:
    """Events of a window, and for when its ball is; without one, how many of them a zoomed view shows.

    A view that follows no ball can be dark while the window is full of events.
    """
    found, events = answer.detection, answer.window.events
    text = counted(len(events), "event")
    if found is not None:
        return f"{text}, ball at {answer.valid_us / 1e3:.3f} ms"
    x, y = events.x_px.astype(np.int64) - region.x, events.y_px.astype(np.int64) - region.y
    shown = np.count_nonzero((x >= 0) & (x < region.width) & (y >= 0) & (y < region.height))
    return text if shown == len(events) else f"{text}, {shown:,} in view: Zoom 1 shows all"


def window_before(stream: CameraStream, t_us: int, window_us: int) -> Window:
    """Window that ends at `t_us`; at the start of a recording the first complete one."""
    end_us = max(t_us, window_us)
    return Window(stream.slice(end_us - window_us, end_us), end_us - window_us, end_us)


def _region(request: TuneRequest, answer: WindowAnswer, across: int) -> Region:
    """Visible region around the chosen point, else the ball, the region of interest, its last position, or the
    middle.
    """
    sensor, view, found = request.stream.sensor, request.view, answer.detection
    searched_px = None if answer.trace is None else answer.trace.centre_px
    if view.zoom <= 1.0:
        return Region.of_sensor(sensor)
    if view.centre_px is not None:
        centre = view.centre_px
    elif found is not None:
        centre = (found.u_px, found.v_px)
    elif searched_px is not None:
        centre = searched_px
    elif request.last_px is not None:
        centre = request.last_px
    else:
        centre = (sensor.width_px / 2, sensor.height_px / 2)
    aspect = request.aspect
    if aspect is not None:  # of each picture
        aspect *= -(-request.tiles // across) / across
    return Region.around(*centre, sensor, view.zoom, aspect)
