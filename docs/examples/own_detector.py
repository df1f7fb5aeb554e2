"""A detector of your own, scored beside the built-in one: `python docs/examples/own_detector.py [RECORDING]`.

It takes the median of the ON events in every window: pixels off while only the ball moves, lost when anybody does.
"""

import numpy as np
from small_input import recording_path

from core.detection import Detection, auto_config
from core.events import Window
from core.metrics import score_recording
from core.recordings import open_recording


class MedianDetector:
    """The median of the ON events of a window, if there are enough of them."""

    extra_circles = 0
    """It never finds more than one ball."""

    def __init__(self, fewest: int = 30) -> None:
        self.fewest = fewest

    def reset(self) -> None:
        """Do nothing: this detector remembers nothing."""

    def step(self, window: Window) -> Detection | None:
        """The ball in this window, or None."""
        on = window.events.on
        if on.sum() < self.fewest:
            return None
        x_px, y_px = window.events.x_px[on], window.events.y_px[on]
        radius_px = max(1.0, float(np.hypot(x_px.std(), y_px.std())))
        return Detection(window.end_us, float(np.median(x_px)), float(np.median(y_px)), radius_px)


with open_recording(recording_path()) as recording:
    camera = next(iter(recording.cameras.values()))
    for name, detector in (("median", MedianDetector()), ("auto", auto_config())):
        score = score_recording(camera, detector, window_us=2000)
        print(f"{name}: precision {score.precision:.3f}, recall {score.recall:.3f}, {score.median_error_px:.2f} px")
