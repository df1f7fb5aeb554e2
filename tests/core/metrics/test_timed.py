"""What a window costs."""

import threading

import cv2

from core.detection import Detection
from core.events import Events, SensorSize, Window
from core.metrics.run import TimedDetector, one_opencv_thread

WINDOW = Window(Events.empty(SensorSize(8, 8)), 0, 1000)


class Counts:
    """Computes as long as it is told."""

    extra_circles = 3

    def __init__(self) -> None:
        self.rounds = 0

    def reset(self) -> None:
        self.rounds = 0

    def step(self, window: Window) -> Detection | None:
        self.rounds += sum(1 for _ in range(200_000))
        return Detection(window.end_us, 1.0, 2.0, 3.0)


def test_every_step_is_timed_and_answered_as_the_detector_does() -> None:
    timed = TimedDetector(Counts())
    assert timed.step(WINDOW) == Detection(1000, 1.0, 2.0, 3.0) and timed.extra_circles == 3
    timed.reset()
    timed.step(WINDOW)
    assert len(timed.seconds) == 2 and all(1e-4 < seconds < 1.0 for seconds in timed.seconds)


def test_opencv_has_its_threads_again_when_the_last_one_is_out() -> None:
    cv2.setNumThreads(2)
    before, entered, leave = cv2.getNumThreads(), threading.Event(), threading.Event()

    def other() -> None:
        with one_opencv_thread():
            entered.set()
            leave.wait(300)

    thread = threading.Thread(target=other)
    with one_opencv_thread():
        thread.start()
        assert entered.wait(300) and cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == 1, "the other one is still inside"
    leave.set()
    thread.join(10)
    assert cv2.getNumThreads() == before == 2
