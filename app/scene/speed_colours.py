"""Colours by speed: from magenta over coral to pale yellow, lighter and lighter, the upper part of `plasma`.

Its lightness grows evenly with the speed, so that it is read without seeing red or green, and no part of it is blue as
the table is.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app import theme

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
