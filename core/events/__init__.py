"""Events of one sensor as a frozen value, windows of them, and what is drawn and counted from them."""

from core.events.events import Events, SensorSize, concatenate_events
from core.events.window import Window

__all__ = ["Events", "SensorSize", "Window", "concatenate_events"]
