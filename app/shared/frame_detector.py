"""The detector of frame cameras, where what it needs is installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

from core.detection import Detector


def frame_detector() -> Callable[[], Detector] | None:
    """Makes a detector of pictures; None in a light installation, which follows the event cameras alone."""
    return _make if importlib.util.find_spec("torch") is not None else None


def _make() -> Detector:
    from core.detection.yolo.detector import YoloDetector  # late: torch takes a second
    from core.detection.yolo.weights import load_weights

    return YoloDetector(load_weights())
