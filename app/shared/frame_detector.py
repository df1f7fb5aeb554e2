"""The detector of frame cameras, where what it needs is installed."""

from __future__ import annotations

from collections.abc import Callable

from core.detection import Detector
from core.errors import PackageError
from core.extras import require_package


def frame_detector() -> Callable[[], Detector] | None:
    """Makes a detector of pictures; None in a light installation, which follows the event cameras alone."""
    try:
        require_package("torch", "a detector of pictures")
    except PackageError:
        return None
    return _make


def _make() -> Detector:
    from core.detection.yolo.detector import YoloDetector  # late: torch takes a second
    from core.detection.yolo.weights import load_weights

    return YoloDetector(load_weights())
