"""EBPP as a detector: every event updates the surface, every window is asked for a circle."""

from __future__ import annotations

from core.detection.detector import Detection
from core.detection.ebpp.eros import blank_surface, eros_rule, picture_of, update_surface
from core.detection.ebpp.hough import find_circles
from core.detection.ebpp_config import EbppConfig
from core.detection.stages.roi import Centre, RoiConfig, next_region, roi_around
from core.events import SensorSize, Window


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
