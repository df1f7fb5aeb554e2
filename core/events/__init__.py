"""Events of one sensor as a frozen value, windows of them, and what is drawn and counted from them."""

from core.events.camera_frame import CameraFrame
from core.events.events import Events, SensorSize, concatenate_events
from core.events.health import Health, assess_health, sample_spans
from core.events.image import count_image, polarity_image, time_surface
from core.events.rates import RateCurve, rate_curve
from core.events.window import Window

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
