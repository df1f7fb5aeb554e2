"""Content of the middle of the window: encoded pictures laid out as a mosaic, measured in picture pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.pictures.canvas import Canvas, Region
from app.pictures.palette import PolarityColours, palette
from app.state.client_state import Arrangement

GAP_PX = 12
MANY: Final = 4


@dataclass(frozen=True, slots=True)
class MosaicTile:
    """One encoded picture with its place on the sheet."""

    png: bytes
    region: Region
    """Part of the sensor that it shows."""
    x: int
    y: int
    width: int
    height: int
    is_other: bool = False
    """Whether it is of another sensor than the sheet: no point of it is one of the sheet's sensor."""

    def sensor_point(self, x: float, y: float) -> tuple[float, float] | None:
        """Sensor coordinates of a point of the sheet; None outside the picture, and on one of another sensor.

        Sheet point (0.0, 0.0) is the top left corner of the sheet, not a pixel centre.
        """
        across, down = (x - self.x) / self.width, (y - self.y) / self.height
        if self.is_other or not (0 <= across < 1 and 0 <= down < 1):
            return None
        return self.region.x + across * self.region.width - 0.5, self.region.y + down * self.region.height - 0.5


@dataclass(frozen=True, slots=True)
class SheetText:
    """Text on the mosaic."""

    x: float
    y: float
    """Position of the lower left corner, in pixels of the mosaic."""
    text: str
    colour: str
    """CSS colour."""
    is_title: bool
    """Whether it is a picture's title; other texts move away from it."""


@dataclass(frozen=True, slots=True)
class Mosaic:
    """All pictures and the size of the whole."""

    pictures: tuple[MosaicTile, ...]
    width: int
    height: int
    texts: tuple[SheetText, ...] = ()
    ball_cells: tuple[tuple[str, int], ...] = ()
    """Cell of each camera's picture in which the ball was found, if it was searched."""

    def sensor_point(self, x: float, y: float) -> tuple[float, float] | None:
        """Sensor coordinates under a point of the sheet, None beside the pictures."""
        hits = (picture.sensor_point(x, y) for picture in self.pictures)
        return next((hit for hit in hits if hit is not None), None)


def lay_out(canvases: Sequence[Canvas], colours: PolarityColours, arrangement: Arrangement) -> Mosaic:
    """Encode drawn canvases and place them beside or below each other."""
    return lay_out_grid(canvases, colours, columns_of(len(canvases), arrangement))


def columns_that_fill(pictures: int, picture_aspect: float, room_aspect: float) -> int:
    """How many of these equal pictures stand beside each other where each is to be as large as it can be.

    Args:
        pictures: how many there are.
        picture_aspect: width over height of each.
        room_aspect: width over height of what is free for all of them.
    """

    def height(columns: int) -> float:
        """Height of a picture, as a share of the room's."""
        return min(1 / math.ceil(pictures / columns), room_aspect / (columns * picture_aspect))

    return max(range(pictures, 0, -1), key=height, default=1)


def columns_of(pictures: int, arrangement: Arrangement) -> int:
    """How many pictures stand beside each other; four or more make rows, so that they are not too small."""
    if arrangement == "stacked":
        return 1
    return pictures if pictures < MANY else math.ceil(math.sqrt(pictures))


def lay_out_grid(canvases: Sequence[Canvas], colours: PolarityColours, columns: int) -> Mosaic:
    """Encode drawn canvases and place them in rows of this many."""
    pictures: list[MosaicTile] = []
    texts: list[SheetText] = []
    x = y = below = 0
    for number, canvas in enumerate(canvases):
        height, width = canvas.image.shape
        if number % columns == 0:
            x, y = 0, below
        pictures.append(MosaicTile(canvas.encode(colours), canvas.region, x, y, width, height))
        texts += [
            SheetText(x + one.x, y + one.y, one.text, css_colour(one.ink, colours), one.is_title)
            for one in canvas.texts
        ]
        x += width + GAP_PX
        below = max(below, y + height + GAP_PX)
    corners: NDArray[np.int64] = np.array([(p.x + p.width, p.y + p.height) for p in pictures] or [(1, 1)])
    width, height = map(int, corners.max(axis=0))
    return Mosaic(tuple(pictures), width, height, tuple(texts))


def css_colour(ink: int, colours: PolarityColours) -> str:
    """CSS colour of a palette index."""
    return "#{:02x}{:02x}{:02x}".format(*palette(colours)[ink].tolist())
