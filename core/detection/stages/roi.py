"""Region of interest: search around the last ball, and the whole sensor after several misses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.events import Events


@dataclass(frozen=True, slots=True, kw_only=True)
class RoiConfig:
    """Size and reset of the region of interest."""

    enabled: bool = True
    """Follow the ball with a region of interest; without it every window is searched on the whole sensor."""
    roi_expand_px: float = setting(50.0, 5.0, 400.0, step=1.0)
    """Half the side of the square around the last centre. Largest ball (20 px) plus two windows of the fastest motion
    (4 px/ms) plus a margin."""
    misses_to_reset: int = setting(3, 1, 50)
    """Windows in a row without a ball before the whole sensor is searched again (paper: 3)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class Roi:
    """A rectangle of pixels, borders included; it may extend beyond the sensor."""

    x_min: int
    x_max: int
    y_min: int
    y_max: int


Centre = tuple[float, float]
"""u_px, v_px of the last detected ball."""


def roi_around(centre_px: Centre | None, config: RoiConfig) -> Roi | None:
    """The region around the last centre; None means the whole sensor (paper, adaptive ROI)."""
    return None if centre_px is None or not config.enabled else square_around(centre_px, config.roi_expand_px)


def square_around(centre_px: Centre, half_px: float) -> Roi:
    """The pixels at most `half_px` to each side of a centre."""
    u, v = centre_px
    return Roi(math.ceil(u - half_px), math.floor(u + half_px), math.ceil(v - half_px), math.floor(v + half_px))


def inside_roi(events: Events, roi: Roi) -> NDArray[np.bool_]:
    """(N,) True for events in the region."""
    x, y = events.x_px, events.y_px
    return (roi.x_min <= x) & (x <= roi.x_max) & (roi.y_min <= y) & (y <= roi.y_max)


def next_region(
    centre_px: Centre | None, misses: int, found_px: Centre | None, config: RoiConfig
) -> tuple[Centre | None, int]:
    """Centre and count of misses for the next window, after a window with the ball at `found_px` or without one."""
    if found_px is not None:
        # Rounded because centres fall on half pixels: the last digits of a circle must not decide about a whole column.
        return (round(found_px[0], 2), round(found_px[1], 2)), 0
    if centre_px is None or misses + 1 >= config.misses_to_reset:
        return None, 0
    return centre_px, misses + 1
