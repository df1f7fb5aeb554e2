"""Denoise: a morphological opening of the window's binary image keeps what is at least as thick as the kernel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.errors import ConfigError
from core.events import Events


@dataclass(frozen=True, slots=True, kw_only=True)
class DenoiseConfig:
    """Thickness of the structures that are kept."""

    kernel_px: int = setting(3, 1, 9, step=2)
    """Diameter of the elliptical kernel, odd; 1 keeps everything. 3 removes single pixels and lines, and with them
    noise of up to 5 events per second and pixel."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.kernel_px % 2 == 0:
            raise ConfigError(
                "kernel has no middle", expected="odd", got=self.kernel_px, where="DenoiseConfig.kernel_px"
            )


def survives_opening(events: Events, config: DenoiseConfig) -> NDArray[np.bool_]:
    """(N,) True for events whose pixel survives the opening of the binary image of all of them (paper, denoising)."""
    if not len(events):
        return np.zeros(0, np.bool_)
    x, y = events.x_px.astype(np.intp), events.y_px.astype(np.intp)
    # One empty pixel all round: OpenCV's erosion takes what lies outside the picture for set, and then an event on the
    # border of the bounding rectangle, and so a distant noise pixel, would decide what survives.
    column, row = x - x.min() + 1, y - y.min() + 1
    image = np.zeros((row.max() + 2, column.max() + 2), np.uint8)
    image[row, column] = 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (config.kernel_px, config.kernel_px))
    return cv2.morphologyEx(image, cv2.MORPH_OPEN, kernel)[row, column] != 0
