"""The 3D scene of one window's events in space and time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.view_camera import framed
from app.views.space_time import SpaceTime, Tick, event_at
from app.views.viewpoint import Viewpoint, look

ROOT: Final = "/space-time"
POINT_SIZE: Final = 0.004
"""About 2 px of 720, in units of the box."""
FRAME_RGB: Final = (92, 97, 110)
SLAB_RGB: Final = (235, 235, 235)
TRUTH_RGB: Final = (60, 230, 230)
LABEL_SIZE: Final = 0.8
LABELS: Final = 18
"""Most ticks: `round_values` gives up to five an axis."""
FROM: Final = Viewpoint((-1.1, -2.3, 1.0), (0.0, 0.0, 0.0))
"""Time goes to the right, the sensor is seen from behind and above."""
MARGIN: Final = 0.07
"""Free on each side for the labels."""
MIN_RESHAPE: Final = 0.03
"""Smallest change of a shape after which the view is reset."""
NO_SHAPE: Final = (0.0,) * 5
NEAR, FAR = 0.01, 30.0
_NO_POINTS: Final = np.zeros((1, 3), np.float32)
_NO_LINES: Final = np.zeros((1, 2, 3), np.float32)


class SpaceTimeScene:
    """Handles of one browser, made when it is first shown and reused for every window."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self.on_pick: Callable[[tuple[float, float]], None] | None = None
        """Called, in viser's thread, with the pixel of each event that is clicked."""
        self._root: viser.FrameHandle | None = None
        self._shown: SpaceTime | None = None
        self._shape = NO_SHAPE

    @property
    def visible(self) -> bool:
        """Whether it is what the middle of the window shows."""
        return self._root is not None and self._root.visible

    def set_visible(self, visible: bool) -> None:
        """Show or hide it; the view is reset by the next `stand`."""
        if visible and self._root is None:
            self._build()
        if self._root is not None and self._root.visible != visible:
            self._root.visible = visible
            self._shape = NO_SHAPE

    def stand(self, aspect: float, panel_share: float) -> None:
        """Look at the whole box, if that or the free part of the window has another shape than at the last time.

        Args:
            aspect: width over height of the window.
            panel_share: of its height that a panel covers at the bottom.
        """
        if not self.visible or self._shown is None:
            return
        corners = self._shown.frame.reshape(-1, 3)
        shape = (aspect, panel_share, *map(float, corners.max(axis=0)))
        if float(np.abs(np.subtract(shape, self._shape)).max()) > MIN_RESHAPE:
            self._shape = shape
            look(self._client, above_panel(FROM, corners, aspect, panel_share), near=NEAR, far=FAR)

    def show(self, shown: SpaceTime) -> None:
        """Show another window."""
        if self._root is None:
            return
        self._shown = shown
        with self._client.atomic():
            self._cloud.visible = len(shown.points) > 0
            if len(shown.points):
                self._cloud.points, self._cloud.colors = shown.points, shown.colours
            for handle, lines in (
                (self._frame, shown.frame),
                (self._slab, shown.slab),
                (self._tube, shown.tube),
                (self._mark, shown.mark),
                (self._truth, shown.truth),
            ):
                handle.visible = len(lines) > 0
                if len(lines):
                    handle.points = lines
            self._tube.colors = np.array(shown.tube_rgb, np.uint8)
            self._mark.colors = np.array(shown.mark_rgb, np.uint8)
            self._show_ticks(shown.ticks)

    def _show_ticks(self, ticks: tuple[Tick, ...]) -> None:
        for label, tick in zip(self._labels, ticks, strict=False):
            label.text, label.position, label.visible = tick.text, tick.place, True
        for label in self._labels[len(ticks) :]:
            label.visible = False

    def _build(self) -> None:
        scene = self._client.scene
        self._root = scene.add_frame(ROOT, show_axes=False, visible=False)
        self._cloud = scene.add_point_cloud(
            f"{ROOT}/events",
            _NO_POINTS,
            np.zeros((1, 3), np.uint8),
            point_size=POINT_SIZE,
            point_shape="circle",
            point_shading="flat",
            visible=False,
        )
        self._frame = self._add_lines("frame", FRAME_RGB, 1.0)
        self._slab = self._add_lines("window", SLAB_RGB, 1.5)
        self._tube = self._add_lines("ball", SLAB_RGB, 1.5)
        self._mark = self._add_lines("mark", SLAB_RGB, 2.5)
        self._truth = self._add_lines("truth", TRUTH_RGB, 2.0)
        self._labels = [
            scene.add_label(f"{ROOT}/tick{k}", "", anchor="top-center", font_screen_scale=LABEL_SIZE, visible=False)
            for k in range(LABELS)
        ]

        async def clicked(event: viser.SceneClickEvent) -> None:
            if self.visible and self._shown is not None:
                point = event_at(self._shown, event.ray_origin, event.ray_direction)
                if point is not None and self.on_pick is not None:
                    self.on_pick(point)

        scene.on_click()(clicked)  # pyright: ignore[reportArgumentType]

    def _add_lines(self, name: str, rgb: tuple[int, int, int], width_px: float) -> viser.LineSegmentsHandle:
        return self._client.scene.add_line_segments(
            f"{ROOT}/{name}", _NO_LINES, rgb, thickness=width_px, thickness_units="screen", visible=False
        )


def above_panel(viewpoint: Viewpoint, corners: NDArray[np.floating], aspect: float, panel_share: float) -> Viewpoint:
    """The viewpoint from which the box fills the part of a window above a panel.

    Args:
        viewpoint: direction and lens.
        corners: (N, 3) of the box.
        aspect: width over height of the window.
        panel_share: of its height that the panel covers.
    """
    free = 1 - panel_share
    slope = math.tan(viewpoint.fov_rad / 2)
    part = Viewpoint(viewpoint.position, viewpoint.look_at, viewpoint.up, 2 * math.atan(slope * free))
    seen = framed(part, corners, aspect / free, MARGIN)
    position, look_at = np.array(seen.position), np.array(seen.look_at)
    forward = look_at - position
    distance = float(np.linalg.norm(forward))
    right = np.cross(forward, viewpoint.up)
    down = np.cross(forward, right) / np.linalg.norm(np.cross(forward, right))
    shift = down * panel_share * slope * distance  # what is free has its middle so far above the window's
    moved = [(float(x), float(y), float(z)) for x, y, z in (position + shift, look_at + shift)]
    return Viewpoint(moved[0], moved[1], viewpoint.up, viewpoint.fov_rad)
