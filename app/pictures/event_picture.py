"""Events of a window as a picture: by polarity, by count, or by age."""

from __future__ import annotations

from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from app.pictures.palette import RAMP_COLOURS, PaletteIndex
from core.events import Window, count_image, polarity_image, time_surface

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
