"""EBPP as a detector: events update a surface, EROS, and each window is searched for a circle.

EROS, the exponential reduced ordinal surface, is an 8-bit picture of the edges that does not depend on their speed.
An event sets its pixel to 255 and lets the brighter pixels around it decay, so an edge that moves on wipes out where
it was, and one that stands still stays (Glover et al. 2021; the rule is that of robotology/event-driven).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection.detector import Detection
from core.detection.ebpp_config import EbppConfig
from core.detection.stages.roi import Centre, Roi, RoiConfig, next_region, roi_around
from core.events import SensorSize, Window
from core.jit import njit

LONG_AGO_US: Final = -(1 << 60)


class ErosRule(NamedTuple):
    """How an event changes the surface."""

    kernel_px: int
    decayed: NDArray[np.uint8]
    """(256,) decayed value of each value."""
    support_us: int
    """Largest age of a neighbour's event for an event to count, us; 0 counts all."""


class ErosSurface(NamedTuple):
    """The surface and what the filter before it remembers, both with a margin that makes bounds checks superfluous."""

    values: NDArray[np.uint8]
    """(height + 2 m, width + 2 m), m = half the kernel; the margin stays 0."""
    last_us: NDArray[np.int64]
    """(height + 2, width + 2) last event of each pixel; one value if the filter is off."""


def eros_rule(kernel_px: int, decay: float, support_us: int) -> ErosRule:
    """The rule with a decay of `decay ** (1 / kernel_px)` for each event, cut off to whole numbers."""
    decayed = (np.arange(256) * decay ** (1.0 / kernel_px)).astype(np.uint8)
    return ErosRule(kernel_px, decayed, support_us)


def blank_surface(sensor: SensorSize, rule: ErosRule) -> ErosSurface:
    """Surface without any events."""
    margin = rule.kernel_px - 1
    remembered = (sensor.height_px + 2, sensor.width_px + 2) if rule.support_us else (1, 1)
    return ErosSurface(
        np.zeros((sensor.height_px + margin, sensor.width_px + margin), np.uint8),
        np.full(remembered, LONG_AGO_US, np.int64),
    )


def picture_of(surface: ErosSurface, rule: ErosRule) -> NDArray[np.uint8]:
    """(height, width) the surface without its margin, not copied."""
    half = rule.kernel_px // 2
    height, width = surface.values.shape
    return surface.values[half : height - half, half : width - half]


@njit
def update_surface(t_us, x_px, y_px, surface: ErosSurface, rule: ErosRule) -> None:
    """Update the surface with events of both polarities, in order of time."""
    values, side, half = surface.values, rule.kernel_px, rule.kernel_px // 2
    for i in range(len(t_us)):
        x, y = np.int64(x_px[i]), np.int64(y_px[i])
        if rule.support_us and not _has_support(surface.last_us, x, y, t_us[i], rule.support_us):
            continue
        before = values[y + half, x + half]
        for row in range(y, y + side):
            line = values[row, x : x + side]
            for k in range(side):
                if line[k] > before:
                    line[k] = rule.decayed[line[k]]
        values[y + half, x + half] = 255


@njit
def _has_support(last_us, x, y, t_us, support_us):
    """Whether one of the eight neighbours had a recent event; stores this event's time."""
    since = t_us - support_us
    last_us[y + 1, x + 1] = LONG_AGO_US
    found = False
    for row in range(y, y + 3):
        for column in range(x, x + 3):
            found |= last_us[row, column] >= since
    last_us[y + 1, x + 1] = t_us
    return found


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
