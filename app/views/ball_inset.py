"""The ball, magnified in a corner of a picture that shows a whole sensor: there it is a few pixels wide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from app.pictures.canvas import Canvas, PictureText, Region, Rendering, event_picture
from app.pictures.palette import PaletteIndex
from core.events import Events, SensorSize, Window

MAGNIFICATION: Final = 8
"""Magnification beside that of the picture; less for a ball that would not fit."""
SHARE: Final = 0.32
"""Side of the inset, as a share of the picture's shorter side."""
RADII: Final = 3.0
"""Least side of what the inset shows, in radii of the ball."""
MARGIN_PX: Final = 4
"""Distance from the picture's edges, in pixels of the picture."""


def draw_ball_inset(
    canvas: Canvas,
    window: Window,
    ball: tuple[float, float, float],
    rendering: Rendering,
    draw_marks: Callable[[Canvas], None],
    *,
    titled: bool = True,
) -> None:
    """Draw the surroundings of a ball (u, v, r, px) magnified into the corner of `canvas` that is far from it.

    Nothing is drawn into a picture that is too small for it. Texts of what the inset covers are removed.

    Args:
        canvas: the picture.
        window: its events.
        ball: u, v and r, px on the sensor.
        rendering: how events are drawn.
        draw_marks: draws into the magnified part.
        titled: whether the inset has a title.
    """
    height, width = canvas.image.shape
    space_px = round(SHARE * min(height, width))
    shown_px = round(max(space_px / (MAGNIFICATION * canvas.scale), RADII * ball[2]))
    if not 8 <= shown_px <= space_px:
        return
    region = Region(round(ball[0] - (shown_px - 1) / 2), round(ball[1] - (shown_px - 1) / 2), shown_px, shown_px)
    inset = Canvas(region, width_px=space_px)
    inset.paint_crop(event_picture(_window_in(window, region), rendering))
    draw_marks(inset)
    side = inset.image.shape[0]
    inset.image[[0, -1], :] = inset.image[:, [0, -1]] = PaletteIndex.TEXT
    u_px, v_px = ball[0] - canvas.region.x, ball[1] - canvas.region.y
    is_right, is_low = u_px > canvas.region.width / 2, v_px > canvas.region.height / 2
    left = MARGIN_PX if is_right else width - side - MARGIN_PX
    top = MARGIN_PX if is_low and not is_right else height - side - MARGIN_PX  # the title is at the upper left
    if left < 0 or top < 0:
        return
    canvas.image[top : top + side, left : left + side] = inset.image
    canvas.texts[:] = [one for one in canvas.texts if one.is_title or not _is_in(one, left, top, side)]
    if titled:
        text = f"x{inset.scale / canvas.scale:.0f}"
        canvas.texts.append(PictureText(left + MARGIN_PX, top + side - MARGIN_PX, text, PaletteIndex.TEXT, False))


def _is_in(text: PictureText, left: int, top: int, side: int) -> bool:
    """Whether what a text belongs to is below the inset."""
    return left <= text.x < left + side and top <= text.y < top + side


def _window_in(window: Window, region: Region) -> Window:
    """The window's events in a region, with addresses from its corner."""
    events = window.events
    x_px, y_px = events.x_px.astype(np.int64) - region.x, events.y_px.astype(np.int64) - region.y
    inside = (x_px >= 0) & (x_px < region.width) & (y_px >= 0) & (y_px < region.height)
    sensor = SensorSize(region.width, region.height)
    part = Events.from_columns(events.t_us[inside], x_px[inside], y_px[inside], events.on[inside], sensor)
    return replace(window, events=part)
