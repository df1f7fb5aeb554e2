"""EBPP as a detector: events update the surface, and each window is searched for a circle."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.ebpp.eros import blank_surface, eros_rule, picture_of, update_surface
from core.detection.ebpp_config import EbppConfig
from core.detection.stages.roi import Centre, Roi, RoiConfig, next_region, roi_around
from core.events import SensorSize, Window

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


class EbppDetector:
    """Answers with the circle of the most votes, near the last one as long as it is not missed for a while.

    An estimate is valid at the end of its window less `delay_us`: the surface shows where the edges are, however long
    ago they began to move. A window without any event has no ball, whatever the surface still shows.
    """

    def __init__(self, config: EbppConfig, sensor: SensorSize) -> None:
        self.config = config
        self.sensor = sensor
        self._rule = eros_rule(config.kernel_px, config.decay, config.support_us)
        self._region = RoiConfig(roi_expand_px=config.roi_expand_px, misses_to_reset=config.misses_to_reset)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen before."""
        self._surface = blank_surface(self.sensor, self._rule)
        self._centre_px: Centre | None = None
        self._misses = 0
        self.extra_circles = 0

    def step(self, window: Window) -> Detection | None:
        """The ball at the end of this window less the sensor's delay, or None. The window may be empty."""
        events = window.events
        if events.sensor != self.sensor:
            self.sensor = events.sensor
            self.reset()
        self.extra_circles = 0
        detection, found_px = None, None
        if len(events):
            update_surface(events.t_us, events.x_px, events.y_px, self._surface, self._rule)
            roi = roi_around(self._centre_px, self._region)
            circles = find_circles(picture_of(self._surface, self._rule), roi, self.config)
            if len(circles):
                u, v, r = circles[0].tolist()
                found_px = u, v
                detection = Detection(window.end_us - self.config.delay_us, u, v, r)
                self.extra_circles = len(circles) - 1
        self._centre_px, self._misses = next_region(self._centre_px, self._misses, found_px, self._region)
        return detection
