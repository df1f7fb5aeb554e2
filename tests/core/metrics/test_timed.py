"""What a window costs."""

import threading

import cv2
import pytest

from core.detection import Detection
from core.events import Events, SensorSize, Window
from core.metrics.run import TimedDetector, one_opencv_thread
from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.numeric
WINDOW = Window(Events.empty(SensorSize(8, 8)), 0, 1000)


class Slower:
    """Its first step takes a quarter of a second of processor time, and each one a quarter more than the last."""

    extra_circles = 3

    def __init__(self) -> None:
        self.clock_s = self.takes_s = 0.0

    def reset(self) -> None:
        self.takes_s = 0.0

    def step(self, window: Window) -> Detection | None:
        self.takes_s += 0.25
        self.clock_s += self.takes_s
        return Detection(window.end_us, 1.0, 2.0, 3.0)


def test_every_step_is_timed_and_answered_as_the_detector_does(monkeypatch: pytest.MonkeyPatch) -> None:
    timed = TimedDetector(slower := Slower())
    monkeypatch.setattr("core.metrics.run.time.thread_time", lambda: slower.clock_s)
    assert timed.step(WINDOW) == Detection(1000, 1.0, 2.0, 3.0) and timed.extra_circles == 3
    timed.step(WINDOW)
    timed.reset()
    slower.clock_s += 10.0  # between two steps
    timed.step(WINDOW)
    assert timed.seconds == [0.25, 0.5, 0.25], "the times before a reset are kept"


def test_opencv_has_its_threads_again_when_the_last_one_is_out() -> None:
    cv2.setNumThreads(2)
    before, entered, leave = cv2.getNumThreads(), threading.Event(), threading.Event()

    def other() -> None:
        with one_opencv_thread():
            entered.set()
            leave.wait(PATIENCE_S)

    thread = threading.Thread(target=other)
    with one_opencv_thread():
        thread.start()
        assert entered.wait(PATIENCE_S) and cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == 1, "the other one is still inside"
    leave.set()
    thread.join(PATIENCE_S)
    assert cv2.getNumThreads() == before == 2
