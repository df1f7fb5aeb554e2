"""A detector of your own: `rallyscope serve REC --plugin median_detector.py`, then choose it in Tune.

It takes the middle of the events round their median: near while only the ball moves, lost when anybody does.
"""

from dataclasses import dataclass

import numpy as np

from core.config import check_settings, setting
from core.detection import Detection, register_detector
from core.detection.reasons import Reason
from core.events import SensorSize, Window


@dataclass(frozen=True, slots=True, kw_only=True)
class MedianConfig:
    """Its settings: sliders in Tune, the section [median] of a config file, what `tune --method median` searches."""

    reach_px: float = setting(25.0, 2.0, 200.0)
    """Events farther from the median of all events are left out."""
    fewest: int = setting(60, 1, 2000)
    """Events in a window within this reach; with fewer there is no ball."""
    radius_scale: float = setting(1.4, 0.2, 5.0)
    """Times the spread of the events is the ball's radius."""

    def __post_init__(self) -> None:
        check_settings(self)


class MedianDetector:
    """The mean of the events round the median of a window, if there are enough of them."""

    extra_circles = 0
    """It never finds more than one ball."""

    def __init__(self, config: MedianConfig, sensor: SensorSize) -> None:
        self._config = config
        self._near = 0

    def reset(self) -> None:
        """Do nothing: this detector remembers nothing."""

    def step(self, window: Window) -> Detection | None:
        """The ball in the middle of this window, or None."""
        config, events = self._config, window.events
        self._near = len(events)
        if len(events) < config.fewest:
            return None
        x_px, y_px = events.x_px.astype(np.float64), events.y_px.astype(np.float64)
        near = np.hypot(x_px - np.median(x_px), y_px - np.median(y_px)) <= config.reach_px
        self._near = int(near.sum())
        if self._near < config.fewest:
            return None
        x_px, y_px = x_px[near], y_px[near]
        radius_px = max(1.0, config.radius_scale * float(np.sqrt((x_px.var() + y_px.var()) / 2)))
        return Detection((window.start_us + window.end_us) // 2, float(x_px.mean()), float(y_px.mean()), radius_px)

    def why_not(self) -> tuple[Reason, ...]:
        """Optional: the limit that the last window failed, with the setting that moves it, for `detect` and Tune."""
        return (Reason("events near the median", "median.fewest", self._near, self._config.fewest),)


register_detector("median", MedianDetector, MedianConfig, "the middle of the events round their median", (70, 160, 255))
