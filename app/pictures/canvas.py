"""A rectangle of the sensor as a picture, magnified or binned: crisp pixels, overlays at sub-pixel positions; and
events of a window in it: by polarity, by count, or by age.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Final, Literal, get_args

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from app.pictures.palette import RAMP_COLOURS, PaletteIndex, PolarityColours, palette
from core.events import SensorSize, Window, count_image, polarity_image, time_surface

SUB_PIXEL_BITS = 5
TARGET_WIDTH_PX = 1280
"""A picture is magnified until it is about this wide."""


@dataclass(frozen=True, slots=True)
class Region:
    """Pixels [x, x + width) by [y, y + height); may reach beyond the sensor."""

    x: int
    y: int
    width: int
    height: int

    @staticmethod
    def of_sensor(sensor: SensorSize) -> Region:
        """A canvas that shows the whole sensor."""
        return Region(0, 0, sensor.width_px, sensor.height_px)

    @staticmethod
    def around(u_px: float, v_px: float, sensor: SensorSize, zoom: float, aspect: float | None = None) -> Region:
        """The part of the sensor that a zoom shows, centred on a point.

        It has the sensor's shape, or is as wide as `aspect` times its height; its shorter side is then the height that
        the sensor's shape would have.

        Args:
            u_px: column of the middle.
            v_px: row of the middle.
            sensor: its size.
            zoom: 1 shows the whole sensor.
            aspect: width over height; None: the sensor's.
        """
        width, height = sensor.width_px / zoom, sensor.height_px / zoom
        if aspect is not None:
            width, height = (height * aspect, height) if aspect >= 1 else (height, height / aspect)
        width, height = max(8, round(width)), max(8, round(height))
        return Region(round(u_px - (width - 1) / 2), round(v_px - (height - 1) / 2), width, height)

    def holds(self, u_px: float, v_px: float) -> bool:
        """Whether a point lies in it; the centre of its first pixel is (x, y)."""
        return -0.5 <= u_px - self.x < self.width - 0.5 and -0.5 <= v_px - self.y < self.height - 0.5


@dataclass(frozen=True, slots=True)
class PictureText:
    """Words that stand on a picture; who shows it sets them in real letters, or has them painted."""

    x: float
    y: float
    """Position of the lower left corner, in picture pixels."""
    text: str
    ink: int
    is_title: bool
    """A title stands in the corner. Other texts stand beside their object and move away from others."""


class Canvas:
    """A picture being drawn. `image` is (height, width) uint8 palette indices; its words are kept beside it."""

    def __init__(self, region: Region, *, across: int = 1, width_px: int = TARGET_WIDTH_PX) -> None:
        """`across` pictures share the window's width: text is made larger by as much. It is about `width_px` wide."""
        self.region = region
        self.across = across
        self.scale: float = max(1, round(width_px / region.width))
        """Picture pixels per sensor pixel."""
        self.image = np.full((region.height * self.scale, region.width * self.scale), PaletteIndex.OUTSIDE, np.uint8)
        self.texts: list[PictureText] = []
        self.under: NDArray[np.uint8] | None = None
        """(height, width, 3) RGB picture that is seen where `image` is `BACKGROUND`."""

    @staticmethod
    def of_binned(pixels: NDArray[np.uint8], sensor: SensorSize, binning: int, *, across: int = 1) -> Canvas:
        """A whole-sensor picture whose pixels are `binning` sensor pixels a side.

        Args:
            pixels: (rows, columns) palette indices of the binned picture.
            sensor: its full size.
            binning: sensor pixels a side.
            across: pictures that stand beside each other.
        """
        canvas = Canvas.__new__(Canvas)
        canvas.region, canvas.across = Region.of_sensor(sensor), across
        canvas.scale, canvas.image, canvas.texts, canvas.under = 1 / binning, pixels, [], None
        return canvas

    def paint_pixels(self, pixels: NDArray[np.uint8]) -> None:
        """Fill with a whole-sensor picture (sensor height, sensor width), cropped and magnified."""
        self._paint(pixels, self.image)

    def paint_frame(self, frame: NDArray[np.uint8]) -> None:
        """Put the picture of an ordinary camera, (height, width) or (height, width, 3), under what is drawn.

        It is cropped and magnified as the canvas is; on a binned canvas it is made smaller.
        """
        rgb = frame if frame.ndim == 3 else np.repeat(frame[:, :, None], 3, axis=2)
        if self.scale < 1:
            size = self.image.shape[1], self.image.shape[0]
            self.under = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
            return
        self.paint_pixels(np.full(rgb.shape[:2], PaletteIndex.BACKGROUND, np.uint8))
        self.under = np.zeros((*self.image.shape, 3), np.uint8)
        self._paint(rgb, self.under)

    def encode(self, colours: PolarityColours) -> bytes:
        """The PNG file of what is painted and drawn, without the texts."""
        if self.under is None:
            return encode_png(self.image, colours)
        return encode_over(self.under, self.image, colours)

    def _paint(self, pixels: NDArray[np.uint8], into: NDArray[np.uint8]) -> None:
        region, scale = self.region, int(self.scale)
        height, width = pixels.shape[:2]
        x0, x1 = max(region.x, 0), min(region.x + region.width, width)
        y0, y1 = max(region.y, 0), min(region.y + region.height, height)
        if x1 <= x0 or y1 <= y0:
            return
        crop = pixels[y0:y1, x0:x1]
        if scale > 1:
            crop = crop.repeat(scale, axis=0).repeat(scale, axis=1)
        top, left = (y0 - region.y) * scale, (x0 - region.x) * scale
        into[top : top + crop.shape[0], left : left + crop.shape[1]] = crop

    def paint_crop(self, pixels: NDArray[np.uint8]) -> None:
        """Fill with a picture of just the region (its height, its width), magnified."""
        self.image[:] = pixels.repeat(int(self.scale), axis=0).repeat(int(self.scale), axis=1)

    def draw_polygon(self, points_px: ArrayLike, ink: int, *, thickness: int = 1, closed: bool = True) -> None:
        """Polygon, or open line, through sensor points (N, 2).

        Args:
            points_px: (N, 2) on the sensor.
            ink: palette index.
            thickness: px of the picture.
            closed: whether the last point is joined with the first.
        """
        points = self._fixed(points_px).reshape(1, -1, 2)
        cv2.polylines(self.image, [points], closed, int(ink), thickness, cv2.LINE_8, SUB_PIXEL_BITS)

    def draw_ellipse(self, u_px: float, v_px: float, covariance_px2: ArrayLike, ink: int, *, sigmas: float) -> None:
        """The ellipse of so many standard deviations of a position with covariance xx, xy, yy.

        Args:
            u_px: column on the sensor.
            v_px: row.
            covariance_px2: (3,) xx, xy, yy.
            ink: palette index.
            sigmas: half axes in standard deviations.
        """
        xx, xy, yy = np.asarray(covariance_px2, np.float64)
        values, axes = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        ring = np.column_stack([np.cos(angle), np.sin(angle)]) * (sigmas * np.sqrt(np.maximum(values, 0.0)))
        self.draw_polygon(ring @ axes.T + (u_px, v_px), ink)

    def draw_circle(self, u_px: float, v_px: float, r_px: float, ink: int, *, thickness: int = 1) -> None:
        """Circle in sensor coordinates, with its centre marked.

        Args:
            u_px: column on the sensor.
            v_px: row.
            r_px: radius on the sensor.
            ink: palette index.
            thickness: px of the picture.
        """
        (centre,) = self._fixed([(u_px, v_px)])
        radius = round(r_px * self.scale * 2**SUB_PIXEL_BITS)
        cv2.circle(self.image, tuple(centre), radius, int(ink), thickness, cv2.LINE_8, SUB_PIXEL_BITS)
        x, y = (centre / 2**SUB_PIXEL_BITS).round().astype(int).tolist()
        cv2.drawMarker(self.image, (x, y), int(ink), cv2.MARKER_CROSS, 7 + 2 * thickness, 1)

    def draw_broken_ring(self, u_px: float, v_px: float, radius_px: int, ink: int, *, thickness: int = 1) -> None:
        """Four arcs round a sensor point, of a radius in pixels of the picture, and the point itself.

        Args:
            u_px: column on the sensor.
            v_px: row.
            radius_px: px of the picture.
            ink: palette index.
            thickness: px of the picture.
        """
        (centre,) = self._fixed([(u_px, v_px)])
        x, y = (centre / 2**SUB_PIXEL_BITS).round().astype(int).tolist()
        for begin in (20, 110, 200, 290):
            cv2.ellipse(self.image, (x, y), (radius_px, radius_px), 0, begin, begin + 50, int(ink), thickness)
        cv2.drawMarker(self.image, (x, y), int(ink), cv2.MARKER_CROSS, 7 + 2 * thickness, 1)

    def draw_dots(self, points_px: ArrayLike, ink: int, *, half_px: int = 1) -> None:
        """Small squares at sensor points (N, 2), whatever the magnification."""
        points = (self._fixed(points_px).reshape(-1, 2) / 2**SUB_PIXEL_BITS).round().astype(np.int64)
        height, width = self.image.shape
        for down in range(-half_px, half_px + 1):
            for across in range(-half_px, half_px + 1):
                x, y = points[:, 0] + across, points[:, 1] + down
                seen = (x >= 0) & (x < width) & (y >= 0) & (y < height)
                self.image[y[seen], x[seen]] = ink

    def draw_box(self, x0_px: float, y0_px: float, x1_px: float, y1_px: float, ink: int) -> None:
        """Outline of a rectangle with corners in sensor coordinates.

        Args:
            x0_px: left on the sensor.
            y0_px: top.
            x1_px: right.
            y1_px: bottom.
            ink: palette index.
        """
        self.draw_polygon([(x0_px, y0_px), (x1_px, y0_px), (x1_px, y1_px), (x0_px, y1_px)], ink)

    def write(self, u_px: float, v_px: float, text: str, ink: int) -> None:
        """Text whose lower left corner stands at a sensor point, if that is in the picture.

        Args:
            u_px: column on the sensor.
            v_px: row.
            text: one line.
            ink: palette index.
        """
        region = self.region
        if not (region.x <= u_px < region.x + region.width and region.y <= v_px < region.y + region.height):
            return
        x, y = (self._fixed([(u_px, v_px)])[0] / 2**SUB_PIXEL_BITS).round().astype(int).tolist()
        self.texts.append(PictureText(x, y, text, int(ink), is_title=False))

    def caption(self, text: str, ink: int = PaletteIndex.TEXT) -> None:
        """A title in the upper left corner."""
        size = self._text_size()
        self.texts.append(PictureText(round(16 * size), round(36 * size), text, int(ink), is_title=True))

    def _text_size(self) -> float:
        """Equally large on the screen however wide the picture is and however many share the window."""
        return 0.62 * self.across * self.image.shape[1] / TARGET_WIDTH_PX

    def _fixed(self, points_px: ArrayLike) -> NDArray[np.int32]:
        """Sensor points as fixed-point picture coordinates; the centre of a sensor pixel is that of its block."""
        points = np.asarray(points_px, np.float64) - (self.region.x, self.region.y)
        in_picture = (points + 0.5) * self.scale - 0.5
        limit = 2.0 ** (30 - SUB_PIXEL_BITS)
        return np.round(np.clip(in_picture, -limit, limit) * 2**SUB_PIXEL_BITS).astype(np.int32)


def encode_png(picture: NDArray[np.uint8], colours: PolarityColours) -> bytes:
    """The PNG file of a picture (height, width) of palette indices."""
    image = Image.fromarray(picture).convert("P")
    image.putpalette(palette(colours).tobytes())
    buffer = io.BytesIO()
    image.save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def encode_over(picture: NDArray[np.uint8], overlay: NDArray[np.uint8], colours: PolarityColours) -> bytes:
    """The PNG file of an RGB picture (height, width, 3) with palette indices (height, width) over it.

    `BACKGROUND` is clear.
    """
    shown, drawn = picture[:, :, ::-1].copy(), overlay != PaletteIndex.BACKGROUND
    shown[drawn] = palette(colours)[overlay[drawn]][:, ::-1]
    fine, content = cv2.imencode(".png", shown, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    assert fine
    return content.tobytes()


Rendering = Literal["polarity", "count", "time surface"]
RENDERINGS: Final[tuple[Rendering, ...]] = get_args(Rendering)

COUNT_SATURATION = 6
"""Events per pixel that reach the brightest colour: a ball's edge leaves 1 to 4 per pass."""


def event_picture(window: Window, rendering: Rendering, *, binning: int = 1) -> NDArray[np.uint8]:
    """Palette indices of a window's events, a picture pixel for `binning` sensor pixels a side."""
    events = window.events
    if rendering == "polarity":
        return polarity_image(events, binning=binning)
    if rendering == "count":
        return _ramp(np.minimum(count_image(events, binning=binning) / (COUNT_SATURATION * binning), 1.0))
    tau_us = (window.end_us - window.start_us) / 2
    return _ramp(time_surface(events, now_us=window.end_us, tau_us=tau_us, binning=binning))


def _ramp(strength: NDArray) -> NDArray[np.uint8]:
    """0 as background, (0, 1] along the ramp's brighter two thirds so that a single event is seen."""
    floor = RAMP_COLOURS // 3
    steps = PaletteIndex.RAMP + floor + strength * (RAMP_COLOURS - 1 - floor)
    return np.where(strength > 0, steps, PaletteIndex.BACKGROUND).astype(np.uint8)
