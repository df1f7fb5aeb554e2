"""Events of one sensor as a frozen value, windows of them, and what is drawn and counted from them."""

from core.events.events import Events, SensorSize, concatenate_events, count_image, polarity_image, time_surface
from core.events.health import Health, RateCurve, assess_health, rate_curve, sample_spans
from core.events.window import CameraFrame, Window

__all__ = [
    "CameraFrame",
    "Events",
    "Health",
    "RateCurve",
    "SensorSize",
    "Window",
    "assess_health",
    "concatenate_events",
    "count_image",
    "polarity_image",
    "rate_curve",
    "sample_spans",
    "time_surface",
]
