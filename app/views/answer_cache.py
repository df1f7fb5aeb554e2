"""Cache of answers of methods with memory: each takes tens of windows to compute."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Final

from core.detection import DetectorConfig
from core.detection.methods import Method
from core.metrics.run import WindowAnswer, explain_window
from core.recordings import CameraStream

KEPT: Final = 64


class AnswerCache:
    """The latest answers by camera, method, config and window; from any thread."""

    def __init__(self) -> None:
        self._answers: OrderedDict[object, WindowAnswer] = OrderedDict()
        self._lock = threading.Lock()

    def find(self, stream: CameraStream, method: Method, config: DetectorConfig, t_us: int) -> WindowAnswer:
        """Cached result of `explain_window`."""
        key = (stream, method, config, t_us)
        with self._lock:
            if key in self._answers:
                self._answers.move_to_end(key)
                return self._answers[key]
        # Without the lock: two may compute the same, but none waits for another's window.
        answer = explain_window(stream, method, config, t_us)
        with self._lock:
            self._answers[key] = answer
            while len(self._answers) > KEPT:
                self._answers.popitem(last=False)
        return answer

    def clear(self) -> None:
        """Clear the cache: another recording was opened."""
        with self._lock:
            self._answers.clear()
