"""A picture of any size as the network's input, and its pixels back: made smaller until it fits, with grey borders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError

GREY: Final = 128
"""Grey level of the borders."""


@dataclass(frozen=True, slots=True)
class Letterbox:
    """How a picture lies in the input. The corner of the input is (0, 0) there, the middle of its first pixel 0.5."""

    scale: float
    """Input pixels for one of the picture; at most 1."""
    left_px: int
    """Border of the input; so `top_px`."""
    top_px: int

    def to_picture(self, x_px: float, y_px: float, r_px: float) -> tuple[float, float, float]:
        """A circle of the input in the picture, where the middle of the first pixel is 0."""
        u, v = (x_px - self.left_px) / self.scale - 0.5, (y_px - self.top_px) / self.scale - 0.5
        return u, v, r_px / self.scale


def shrink(image: NDArray[np.uint8], width_px: int, height_px: int) -> tuple[NDArray[np.uint8], float]:
    """The picture (h, w, 3) no larger than that, and its scale; every pixel is the mean of those it stands for.

    Raises:
        RecordingError: if it is no picture of 8-bit levels, (h, w) or (h, w, 3).
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        got = f"{image.shape} of {image.dtype}"
        raise RecordingError("not a picture", expected="(h, w) or (h, w, 3) of uint8", got=got, where="frames/image")
    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    height, width = image.shape[:2]
    scale = min(1.0, width_px / width, height_px / height)
    if scale == 1.0:
        return np.ascontiguousarray(image), scale
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8), scale


def letterbox(image: NDArray[np.uint8], width_px: int, height_px: int) -> tuple[NDArray[np.uint8], Letterbox]:
    """The input (height, width, 3), and where in it the picture lies.

    Raises:
        RecordingError: if it is no picture.
    """
    small, scale = shrink(image, width_px, height_px)
    top, left = (height_px - small.shape[0]) // 2, (width_px - small.shape[1]) // 2
    whole = np.full((height_px, width_px, 3), GREY, np.uint8)
    whole[top : top + small.shape[0], left : left + small.shape[1]] = small
    return whole, Letterbox(scale, left, top)
