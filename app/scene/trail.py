"""Where the ball was, as a line that is coloured by its speed, and the legend of the colours."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from app import theme

Array = NDArray[np.float64]

POINTS: Final = 72
"""The trail always has this many points, so that its handle is reused."""
THICKNESS_PX: Final = 5.0
SAME_COLOUR: Final = 6
"""Colours that differ by so many of 255 levels are not sent again."""


class TrailActor:
    """The trail in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        flat = np.zeros((POINTS - 1, 2, 3), np.float32)
        colours = np.zeros(flat.shape, np.uint8)
        self._colours = np.zeros((POINTS, 3), np.uint8)
        self._line = scene.add_line_segments(
            name, flat, colours, thickness=THICKNESS_PX, thickness_units="screen", visible=False
        )

    def show(self, ps_world_m: Array, speeds_mps: Array) -> None:
        """(N, 3) where the ball was, oldest first, and (N,) how fast; fewer than two points hide it."""
        self._line.visible = len(ps_world_m) > 1
        if len(ps_world_m) > 1:
            points, speeds = resampled(ps_world_m, speeds_mps, POINTS)
            self._line.points = np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
            colours = speed_line_colours(speeds)
            if np.abs(colours.astype(np.int16) - self._colours).max() > SAME_COLOUR:
                self._colours = colours
                self._line.colors = np.stack([colours[:-1], colours[1:]], axis=1)


def resampled(ps_world_m: Array, speeds_mps: Array, points: int) -> tuple[Array, Array]:
    """(points, 3) and (points,) of a path (N, 3), N >= 2, with speeds (N,): rows of the path, both ends among them."""
    rows = (np.arange(points) * (len(ps_world_m) - 1) + (points - 1) // 2) // (points - 1)
    return ps_world_m[rows], speeds_mps[rows]


SLOWEST_MPS: Final = 2.0
FASTEST_MPS: Final = 9.0
"""Serves have 3 to 9 m/s. What is slower or faster has the colour of the end."""
STOPS: Final = np.array([(171, 36, 148), (214, 82, 107), (243, 138, 66), (253, 195, 50), (240, 249, 120)], np.float64)
"""(5, 3) at even steps of speed."""

_LAST: Final = 255
_TABLE: Final = np.round(
    np.stack([np.interp(np.linspace(0, len(STOPS) - 1, _LAST + 1), np.arange(len(STOPS)), c) for c in STOPS.T], axis=1)
).astype(np.uint8)
_LINEAR: Final = np.round(
    255 * np.where(_TABLE <= 0.04045 * 255, _TABLE / 255 / 12.92, ((_TABLE / 255 + 0.055) / 1.055) ** 2.4)
).astype(np.uint8)


def _steps(speeds_mps: ArrayLike) -> NDArray[np.intp]:
    speeds = np.asarray(speeds_mps, np.float64)
    share = (np.where(np.isnan(speeds), SLOWEST_MPS, speeds) - SLOWEST_MPS) / (FASTEST_MPS - SLOWEST_MPS)
    return np.round(_LAST * np.clip(share, 0, 1)).astype(np.intp)


def speed_line_colours(speeds_mps: ArrayLike) -> NDArray[np.uint8]:
    """Speed colours of the points of a line: the browser reads them as linear light, not as sRGB."""
    return _LINEAR[_steps(speeds_mps)]


def speed_colours(speeds_mps: ArrayLike) -> NDArray[np.uint8]:
    """(N, 3) RGB of speeds (N,); an unknown one (NaN) has the colour of the slowest."""
    return _TABLE[_steps(speeds_mps)]


def speed_legend_html() -> str:
    """A bar with its ends."""
    colours = ",".join(f"rgb({r:.0f},{g:.0f},{b:.0f})" for r, g, b in STOPS)
    bar = f"<div style='flex:1;height:8px;border-radius:4px;background:linear-gradient(90deg,{colours})'></div>"
    return (
        f"<div style='display:flex;align-items:center;gap:8px;font-size:12px;color:{theme.MUTED};padding:4px 12px'>"
        f"<span>{SLOWEST_MPS:g}</span>{bar}<span>{FASTEST_MPS:g} m/s</span></div>"
    )
