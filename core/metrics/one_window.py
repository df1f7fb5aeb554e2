"""Answer of a method for one window, after running it over the windows before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from core.detection import Detection, DetectorConfig
from core.detection.methods import Method, make_detector, method_config
from core.events import Window
from core.recordings import CameraStream

LEAD_IN_US: Final = 60_000
"""A method that carries a state finds a ball and locks on in this time: `refined` confirms one within 10 to 40 ms."""


@dataclass(frozen=True, slots=True, eq=False)
class WindowAnswer:
    """A window and its answer."""

    method: Method
    window: Window
    detection: Detection | None
    lead_in_windows: int
    """Windows processed before it; fewer at the start of a recording."""

    @property
    def valid_us(self) -> int:
        """Time at which the answer is valid; the end of the window without one."""
        return self.detection.t_us if self.detection else self.window.end_us


def answer_window(
    stream: CameraStream, method: Method, config: DetectorConfig, t_us: int, *, lead_in_us: int = LEAD_IN_US
) -> WindowAnswer:
    """Run a method over the time before `t_us` and give its answer to the window that ends there.

    At the very start of a recording the window is the first whole one.
    """
    window_us = method_config(method, config).window.window_us
    end_us = max(t_us, window_us)
    start_us = end_us - window_us
    lead_in = min(lead_in_us, start_us) // window_us
    events = stream.slice(start_us - lead_in * window_us, start_us)
    detector = make_detector(method, stream.sensor, config)
    for first_us in range(start_us - lead_in * window_us, start_us, window_us):
        detector.step(Window(events.between(first_us, first_us + window_us), first_us, first_us + window_us))
    window = Window(stream.slice(start_us, end_us), start_us, end_us)  # a copy, as answers may be cached
    return WindowAnswer(method, window, detector.step(window), lead_in)
