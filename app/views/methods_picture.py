"""Several methods on the same window: a tile each, with its ball and its error."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.pictures.canvas import Canvas, Region
from app.pictures.palette import PaletteIndex, method_colour_index
from app.state.client_state import RenderSettings, TuneView
from app.views.answer_cache import AnswerCache
from app.views.mosaic import Mosaic, lay_out_grid
from app.views.requests import PictureAnswer, is_wrong
from app.views.stage_picture import draw_answer
from core.detection import DetectorConfig
from core.detection.methods import Method
from core.metrics.compare import PixelReference
from core.metrics.run import WindowAnswer
from core.recordings import CameraStream

ZOOM: Final = 8.0
"""Zoom of an unzoomed view: the ball and its surroundings are compared, not the whole sensor."""
TILE_WIDTH_PX: Final = 800


@dataclass(frozen=True, slots=True, eq=False)
class MethodsRequest:
    """One time of one camera through several methods, each in windows of its own length."""

    stream: CameraStream
    t_us: int
    look: RenderSettings
    view: TuneView
    configs: tuple[tuple[Method, DetectorConfig], ...]
    answers: AnswerCache
    known: Callable[[], PixelReference | None]
    """Function that reads the camera's truth or labels."""


def answer_methods(request: MethodsRequest) -> PictureAnswer:
    """Tiles and the result of each method."""
    start_s = time.perf_counter()
    found = tuple(request.answers.find(request.stream, *config, request.t_us) for config in request.configs)
    sheet = render_methods(request, found, request.known())
    return PictureAnswer(sheet, found, time.perf_counter() - start_s)


def render_methods(
    request: MethodsRequest, found: tuple[WindowAnswer, ...], reference: PixelReference | None
) -> Mosaic:
    """Draw the tiles; all show the same part of the sensor."""
    region = _region(request, found, reference)
    columns = columns_of(len(found)) if request.look.arrangement != "stacked" else 1
    canvases: list[Canvas] = []
    for answer in found:
        canvas = Canvas(region, across=columns, width_px=TILE_WIDTH_PX)
        ink = method_colour_index(answer.method)
        draw_answer(canvas, answer, request.look.rendering, ink)
        if reference is not None and (request.view.show_truth or request.stream.truth is None):
            _draw_reference(canvas, reference, answer.valid_us)
        canvas.caption(f"{answer.method}: {verdict(answer, reference)}", ink)
        canvases.append(canvas)
    return lay_out_grid(canvases, request.look.colours, columns)


def columns_of(tiles: int) -> int:
    """Number of columns with which the tiles are largest in a wide window."""
    return max(1, math.ceil(math.sqrt(tiles)))


def verdict(answer: WindowAnswer, reference: PixelReference | None) -> str:
    """Text of an answer's error: its distance from the reference at its own time, if known."""
    place = _place(reference, answer.valid_us)
    ball = answer.detection
    if ball is None:
        return "no ball" if place is None else "no ball, missed"
    if place is not None:
        distance_px = math.hypot(ball.u_px - place[0], ball.v_px - place[1])
        return f"{distance_px:.2f} px off, missed" if is_wrong(distance_px) else f"{distance_px:.2f} px"
    if reference is not None and reference.at(np.array([ball.t_us]))[1][0]:
        return "false ball"
    return "ball"


def _place(reference: PixelReference | None, t_us: int) -> tuple[float, float] | None:
    """Position of the ball, if known."""
    if reference is None:
        return None
    there, _ = reference.at(np.array([t_us]))
    return (float(there.u_px[0]), float(there.v_px[0])) if there.visible[0] else None


def _draw_reference(canvas: Canvas, reference: PixelReference, t_us: int) -> None:
    there, _ = reference.at(np.array([t_us]))
    if there.visible[0] and np.isfinite(there.r_px[0]):
        canvas.draw_circle(float(there.u_px[0]), float(there.v_px[0]), float(there.r_px[0]), PaletteIndex.TRUTH)


def _region(request: MethodsRequest, found: tuple[WindowAnswer, ...], reference: PixelReference | None) -> Region:
    """Visible region around the chosen point, else the known ball, else the first detection, else the middle."""
    sensor, view = request.stream.sensor, request.view
    zoomed = view.zoom > 1.0
    balls = [(one.detection.u_px, one.detection.v_px) for one in found if one.detection is not None]
    centre = view.centre_px if zoomed else None
    centre = centre or _place(reference, request.t_us) or next(iter(balls), None)
    centre = centre or (sensor.width_px / 2, sensor.height_px / 2)
    return Region.around(*centre, sensor, view.zoom if zoomed else ZOOM)
