"""Answers of a detector at given times, as at a person's labels: what scores and comparisons on labels both count."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection import Detection, Detector
from core.events import Window
from core.metrics.run import WindowAnswers
from core.recordings import CameraStream

LEAD_IN_WINDOWS: Final = 10
"""Windows that a detector sees before a time that stands alone, to find the ball and lock on."""
LEAD_IN_US: Final = 20_000
"""So much time at least, if windows are short, and before each part that is looked through for proposals."""


def answers_at(
    stream: CameraStream,
    detector: Detector,
    t_us: NDArray[np.int64],
    window_us: int,
    *,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> WindowAnswers:
    """What a detector says of the balls at ascending times: each time, the window whose estimate is for that instant.

    Between the times it sees every window, or a lead-in before a time that stands alone. A detector
    whose estimates are for another instant than the end of its window is asked that much later.

    Args:
        stream: the camera.
        detector: it is reset first.
        t_us: (N,) times.
        window_us: length of its windows.
        progress: is given the share that is done after each time.
        cancelled: is asked before each time; when it becomes true, the answers so far are given.
    """
    detector.reset()
    lead_in = max(LEAD_IN_WINDOWS, LEAD_IN_US // window_us)
    late_us = 0
    rows: list[tuple[float, float, float, int]] = []
    detections: list[Detection] = []
    seen_until = -1
    for number, time_us in enumerate(t_us.tolist()):
        if cancelled is not None and cancelled():
            break
        start = time_us + late_us - window_us
        before = min(lead_in, max(start - seen_until, 0) // window_us if seen_until >= 0 else lead_in)
        if start - before * window_us > seen_until + window_us:
            detector.reset()
        for lead in range(before, 0, -1):
            _step(stream, detector, start - lead * window_us, window_us)
        found = _step(stream, detector, start, window_us)
        seen_until = start + window_us
        if found is None:
            rows.append((np.nan, np.nan, np.nan, detector.extra_circles))
        else:
            rows.append((found.u_px, found.v_px, found.r_px, detector.extra_circles))
            detections.append(found)
            # How late a detector's estimates are is known from its detections only.
            late_us = seen_until - found.t_us
        if progress is not None:
            progress((number + 1) / len(t_us))
    u, v, r, extra = np.array(rows, np.float64).reshape(-1, 4).T
    done_us = t_us[: len(rows)]
    return WindowAnswers(done_us + late_us, done_us, u, v, r, extra.astype(np.int32), tuple(detections))


def _step(stream: CameraStream, detector: Detector, start_us: int, window_us: int) -> Detection | None:
    if start_us + window_us <= 0:
        return None
    start = max(start_us, 0)
    return detector.step(Window(stream.slice(start, start_us + window_us), start, start_us + window_us))
