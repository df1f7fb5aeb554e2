"""Answers at the ascending times of a playback: a method goes on from the answer before where that is less work."""

from __future__ import annotations

from typing import NamedTuple

from core.detection import Detector
from core.detection.methods import make_detector, method_config
from core.detection.saved import SavedDetector
from core.metrics.run import LEAD_IN_US, WindowAnswer, step_before
from core.recordings import CameraStream


class _Reached(NamedTuple):
    """A detector after the answer that it gave last."""

    stream: CameraStream
    saved: SavedDetector
    detector: Detector
    answer: WindowAnswer


class PlaybackAnswers:
    """Keeps the detector of each camera from one picture of a playback to the next; for one thread at a time.

    Of a picture's time nine tenths are the lead-in of `answer_window`: at 20 pictures a second and a quarter of real
    time 60 windows, of which the picture before has processed all but 12.
    """

    def __init__(self) -> None:
        self._reached: dict[str, _Reached] = {}

    def find(self, stream: CameraStream, saved: SavedDetector, t_us: int) -> WindowAnswer:
        """The answer to the window that ends at `t_us`.

        It follows the answer before if that is at most a lead-in ago, else it is that of `answer_window`; so it is
        where both windows overlap: no method takes an event twice. All windows since the answer before end whole
        windows before `t_us`; what is left of a window after that answer is not seen.
        """
        before = self._reached.pop(stream.name, None)  # put back when nothing has failed: a step cannot be undone
        if before is not None and before.stream is not stream:
            self._reached.clear()  # another recording
        window_us = method_config(*saved).window.window_us
        end_us = max(t_us, window_us)
        windows = LEAD_IN_US // window_us
        detector = None
        if before is not None and before.stream is stream and before.saved == saved:
            since_us = end_us - before.answer.window.end_us
            if window_us <= since_us <= LEAD_IN_US:
                windows, detector = since_us // window_us - 1, before.detector
        if detector is None:
            windows = min(windows, end_us // window_us - 1)
            detector = make_detector(saved.method, stream.sensor, saved.config)
        window = step_before(detector, stream, end_us, window_us, windows)
        answer = WindowAnswer(saved.method, window, detector.step(window), windows)
        self._reached[stream.name] = _Reached(stream, saved, detector, answer)
        return answer
