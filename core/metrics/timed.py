"""A detector that measures the processor time of every step."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import cv2

from core.detection import Detection, Detector
from core.events import Window

_inside_lock = threading.Lock()
_inside: list[int] = []
"""OpenCV's previous number of threads, one entry per thread inside `one_opencv_thread`."""


class TimedDetector:
    """A detector that measures this thread's processor time for each window."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self.seconds: list[float] = []

    @property
    def extra_circles(self) -> int:
        """Further circles that the detector found."""
        return self._detector.extra_circles

    def reset(self) -> None:
        """Reset the detector; the times are kept."""
        self._detector.reset()

    def step(self, window: Window) -> Detection | None:
        """Answer of the detector."""
        began_s = time.thread_time()
        found = self._detector.step(window)
        self.seconds.append(time.thread_time() - began_s)
        return found


@contextmanager
def one_opencv_thread() -> Iterator[None]:
    """Keep OpenCV to the calling thread: what it computes in threads of its own would not be counted.

    The number is one of the whole process; the last of several threads that are inside puts it back.
    """
    with _inside_lock:
        _inside.append(_inside[0] if _inside else cv2.getNumThreads())
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        with _inside_lock:
            before = _inside.pop()
            if not _inside:
                cv2.setNumThreads(before)
