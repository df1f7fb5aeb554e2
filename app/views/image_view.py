"""The mosaic in the browser: image planes in front of a camera that faces them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from typing import Final, Literal

import numpy as np
import viser

from app.views.freshness import AnswerFreshness, Staleness
from app.views.mosaic import Mosaic
from app.views.viewpoint import Viewpoint, look
from app.web.pages import Json

Point = tuple[float, float]
DragPhase = Literal["start", "update", "end"]
Drag = Callable[[DragPhase, Point, Point], None]
"""A drag: phase, start and current point, in pixels of the mosaic."""

UNIT: Final = 0.01
"""Scene units per pixel of the mosaic."""
FOV_RAD: Final = math.radians(10)
"""Field of view of the camera: narrow, for almost no perspective; the mapping is exact for any."""
BAR_PX: Final = 80
"""Height of the time bar, px."""
PANEL_PX: Final = 158
"""Height assumed for the panel above it until the page has reported its own, px."""
PANEL_GAP_PX: Final = 10
"""Gap between the panel and what is above and below it, px."""
MAX_FREE_SHARE: Final = 0.8
"""Largest share of the window that is left to what is below the pictures."""
USUAL_HEIGHT_PX: Final = 720
"""Height assumed for a window that has not reported its own."""
BLANK_PNG_PX: Final = np.zeros((1, 1, 3), np.uint8)


class ImageView:
    """Image handles of one browser, reused for every picture."""

    def __init__(self, client: viser.ClientHandle, on_click: Callable[[float, float], None]) -> None:
        self._client = client
        self._images: list[viser.ImageHandle] = []
        self._framed: tuple[float, ...] | None = None
        self._sheet = Mosaic((), 16, 9)
        self._visible = True
        self.freshness = AnswerFreshness()
        """Whether the shown mosaic is the answer to the latest request."""
        self._staleness: Staleness = ""
        self._framing = threading.Lock()
        """Lock: the camera is moved by the loop and by the browser's window reports."""
        self._window_px = USUAL_HEIGHT_PX
        self._panel_px = PANEL_PX
        self._aspect: float | None = None
        self.with_panel = True
        """Whether the mosaic leaves space for a panel above the time bar; takes effect with the next mosaic."""
        self.tell: Callable[[str, Mapping[str, Json]], None] = lambda kind, message: None
        """Sends the page the mosaic's texts and its place in the window."""
        self.on_drag: Drag | None = None
        """Called, in order, for each drag with the left button on a picture."""

        async def clicked(event: viser.SceneClickEvent) -> None:  # async: in the order of the clicks
            if self._visible:
                x, y = mosaic_point(np.array(event.ray_origin), np.array(event.ray_direction))
                on_click(x, y)

        client.scene.on_click()(clicked)  # pyright: ignore[reportArgumentType]

        @client.camera.on_update
        async def _(_: viser.CameraHandle) -> None:
            self.frame()
            self._tell_place()

    @property
    def sheet(self) -> Mosaic:
        """The shown mosaic."""
        return self._sheet

    @property
    def aspect(self) -> float:
        """Width over height of the middle of the window.

        The page's own report where there is one: viser's, made while the middle changes its size, may hold the old one.
        """
        return self._client.camera.aspect if self._aspect is None else self._aspect

    @property
    def free_aspect(self) -> float:
        """Width over height of what is free for pictures above the panel and the time bar, in steps of 0.05."""
        return max(0.2, round(20 * self.aspect / (1 - self.panel_share)) / 20)

    @property
    def panel_share(self) -> float:
        """Share of the window's height that is free below the mosaic."""
        return free_share(self._window_px, self._panel_px if self.with_panel else None)

    def window_resized(self, message: Mapping[str, object]) -> None:
        """Handle the page's report of its window size."""
        height = message.get("height")
        if isinstance(height, int) and 100 <= height <= 20_000:
            self._window_px = height
            self.frame()

    def picture_resized(self, message: Mapping[str, object]) -> None:
        """Handle the page's report of the size of the middle."""
        width, height = message.get("width"), message.get("height")
        if isinstance(width, int) and isinstance(height, int) and all(8 <= px <= 40_000 for px in (width, height)):
            self._aspect = width / height
            self.frame()

    def panel_resized(self, message: Mapping[str, object]) -> None:
        """Handle the page's report of the height of the panel below the pictures."""
        height = message.get("height")
        if isinstance(height, int) and 0 <= height <= 20_000:
            self._panel_px = height
            self.frame()

    def set_visible(self, visible: bool) -> None:
        """Show or hide it in the middle of the window; the view is reset when it is shown."""
        if visible == self._visible:
            return
        with self._framing:
            self._visible = visible
        with self._client.atomic():
            for image, _ in zip(self._images, self._sheet.pictures, strict=False):
                image.visible = visible
        self._tell_texts()
        self.frame(again=True)

    def show_staleness(self, wall_s: float, *, moving: bool) -> None:
        """Mark the page if the shown mosaic is outdated; `moving`: the time cursor plays."""
        staleness = self.freshness.staleness(wall_s, moving=moving) if self._visible else ""
        if staleness != self._staleness:
            self._staleness = staleness
            self.tell("stale", {"why": staleness})

    def show(self, sheet: Mosaic, request: object) -> None:
        """Show the mosaic of a request; the view is reset when its shape has changed."""
        self.freshness.answered(request)
        self._sheet = sheet
        while len(self._images) < len(sheet.pictures):
            self._images.append(self._add_image(len(self._images)))
        with self._client.atomic():
            for image, picture in zip(self._images, sheet.pictures, strict=False):
                image.render_width, image.render_height = picture.width * UNIT, picture.height * UNIT
                centre = (picture.x + picture.width / 2, picture.y + picture.height / 2)
                image.position = (centre[0] * UNIT, centre[1] * UNIT, 0.0)
                set_png(image, picture.png)
                image.visible = self._visible
            for image in self._images[len(sheet.pictures) :]:
                image.visible = False
        self._tell_texts()
        self.frame()

    def _tell_texts(self) -> None:
        texts = self._sheet.texts if self._visible else ()
        self.tell("texts", {"texts": [[one.x, one.y, one.text, one.colour, one.is_title] for one in texts]})

    def _tell_place(self) -> None:
        """Send the window's centre on the mosaic, and the visible height of the mosaic."""
        if self._visible:
            x, y, z = self._client.camera.position.tolist()
            shown = 2 * abs(z) * math.tan(self._client.camera.fov / 2) / UNIT
            self.tell("place", {"x": x / UNIT, "y": y / UNIT, "height": shown})

    def frame(self, *, again: bool = False) -> None:
        """Move the camera so that the whole mosaic fits above the lower panel; `again`: even if nothing changed."""
        with self._framing:
            if self._visible:
                self._frame(again)

    def _frame(self, again: bool) -> None:
        aspect = self.aspect
        wanted = (float(self._sheet.width), float(self._sheet.height), round(aspect, 3), self.panel_share)
        if wanted == self._framed and not again:
            return
        self._framed = wanted
        visible, middle = framing(self._sheet.width, self._sheet.height, aspect, self.panel_share)
        distance = visible * UNIT / 2 / math.tan(FOV_RAD / 2)
        x, y = self._sheet.width * UNIT / 2, middle * UNIT
        viewpoint = Viewpoint((x, y, -distance), (x, y, 0.0), (0.0, -1.0, 0.0), FOV_RAD)
        look(self._client, viewpoint, near=distance * 0.01, far=distance * 10)
        self.tell("place", {"x": x / UNIT, "y": y / UNIT, "height": visible})

    def _add_image(self, index: int) -> viser.ImageHandle:
        image = self._client.scene.add_image(
            f"/sheet/{index}", BLANK_PNG_PX, 1.0, 1.0, format="png", cast_shadow=False, receive_shadow=False
        )

        async def keep(_: viser.SceneNodeDragEvent) -> None:
            """A handled drag is not passed on to the camera: the sheet stays flat in front of it."""

        async def dragged(event: viser.SceneNodeDragEvent) -> None:
            if self.on_drag is not None and self._visible:
                (x0, y0, _), (x1, y1, _) = event.start_position, event.end_position
                self.on_drag(event.phase, (x0 / UNIT, y0 / UNIT), (x1 / UNIT, y1 / UNIT))

        image.on_drag("left")(dragged)
        image.on_drag("right")(keep)
        return image


def free_share(window_px: float, panel_px: float | None) -> float:
    """Share of a window of this height that is below the pictures; `panel_px` is None where no panel stands there."""
    below_px = BAR_PX + (0 if panel_px is None else panel_px + PANEL_GAP_PX)
    return min(MAX_FREE_SHARE, below_px / window_px)


def framing(width: float, height: float, aspect: float, panel_share: float) -> tuple[float, float]:
    """Visible height and centre (downwards) of a mosaic in a window, in pixels of the mosaic.

    Args:
        width: of the mosaic, px.
        height: of the mosaic, px.
        aspect: width over height of the window.
        panel_share: of the window's height that a panel at the bottom covers.
    """
    # A hundredth stays free on each side, so that no edge of a picture touches the window's.
    width, height = width * 1.02, height * 1.02
    visible = max(height / (1 - panel_share), width / aspect)
    top_margin = (visible * (1 - panel_share) - height) / 2
    return visible, visible / 2 - top_margin - height * 0.01


def mosaic_point(ray_origin: np.ndarray, ray_direction: np.ndarray) -> tuple[float, float]:
    """Point where a ray (scene units) meets the mosaic, in pixels of the mosaic."""
    hit = ray_origin - ray_origin[2] / ray_direction[2] * ray_direction
    return float(hit[0]) / UNIT, float(hit[1]) / UNIT


def set_png(image: viser.ImageHandle | viser.GuiImageHandle, png: bytes) -> None:
    """Hand over encoded bytes: viser would encode an RGB array again, ten times slower than an indexed PNG."""
    image._format = "png"
    image._data = png
