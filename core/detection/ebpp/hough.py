"""Circles in a surface: OpenCV's Hough transform along the gradient."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection.ebpp_config import EbppConfig
from core.detection.stages.roi import Roi

Circles = NDArray[np.float64]
"""(N, 3) u_px, v_px, r_px, the one with the most votes first."""


def find_circles(picture: NDArray[np.uint8], roi: Roi | None, config: EbppConfig) -> Circles:
    """The circles of a surface (height, width), in the region or, without one, anywhere."""
    u0 = v0 = 0
    if roi is not None:
        u0, v0 = max(0, roi.x_min), max(0, roi.y_min)
        picture = picture[v0 : max(v0, roi.y_max + 1), u0 : max(u0, roi.x_max + 1)]
    if min(picture.shape) <= config.radius_min_px:
        return np.empty((0, 3))
    # The blurred copy is contiguous, which the surface and a part of it are not.
    blurred = cv2.GaussianBlur(picture, (config.blur_px, config.blur_px), 0)
    found = cv2.HoughCircles(
        blurred,
        cv2.HOUGH_GRADIENT,
        dp=config.cell_px,
        minDist=2 * config.radius_min_px,
        param1=config.canny_high,
        param2=config.votes_full if roi is None else config.votes_roi,
        minRadius=config.radius_min_px,
        maxRadius=config.radius_max_px,
    )
    if found is None:
        return np.empty((0, 3))
    return found[0, :, :3].astype(np.float64) + np.array([u0, v0, 0.0])
