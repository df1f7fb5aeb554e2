"""Running a detector over a recording: every window's answer as plain columns, the answer of one window, the processor
time of every step, and how often it finds a ball in a few stretches of it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.detection import Detection, Detector, DetectorConfig
from core.detection.method_trace import MethodTrace, explain_step
from core.detection.methods import Method, make_detector, method_config
from core.detection.reasons import Reason, ReasonCount, ReasonCounter, reasons_of
from core.detection.refined.detector import SEARCH_EVERY
from core.detection.saved import RIMLESS, load_detector
from core.detection.window import ImageMotion, WindowRule, windows_by_rule
from core.events import Window
from core.recordings import CameraStream
from core.recordings.frames import FrameStream, frame_windows

REPORT_EVERY = 64
"""Windows of events between two reports of progress; a picture takes long enough to report each."""


@dataclass(frozen=True, slots=True, eq=False)
class WindowAnswers:
    """Answers of a detector for N windows in order of time."""

    end_us: NDArray[np.int64]
    """End of the window."""
    t_us: NDArray[np.int64]
    """Time of the estimate; where there is none the end of the window, of a picture its mid exposure."""
    u_px: NDArray[np.float64]
    """nan where no ball was found; so v_px and r_px."""
    v_px: NDArray[np.float64]
    r_px: NDArray[np.float64]
    extra_circles: NDArray[np.int32]
    """Further circles of the window that passed every test."""
    detections: tuple[Detection, ...] = ()
    """Detections with all their fields."""

    @property
    def detected(self) -> NDArray[np.bool_]:
        """(N,) where a ball was found."""
        return ~np.isnan(self.u_px)

    def rows(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> WindowAnswers:
        """Selected rows, in the same order."""
        own = self.detections
        if len(own) == self.detected.sum():  # one for each row with a ball, none for the others
            places = (np.cumsum(self.detected) - 1)[rows][self.detected[rows]]
            own = tuple(own[place] for place in places)
        else:
            own = ()
        return WindowAnswers(
            self.end_us[rows],
            self.t_us[rows],
            self.u_px[rows],
            self.v_px[rows],
            self.r_px[rows],
            self.extra_circles[rows],
            own,
        )


def duration_of(stream: CameraStream) -> int:
    """Microseconds from 0 to the end of the last millisecond with events."""
    return 1000 * len(stream.counts_per_ms())


def run_detector(
    stream: CameraStream,
    detector: Detector,
    window_us: int | WindowRule,
    *,
    start_us: int = 0,
    end_us: int | None = None,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    reasons: ReasonCounter | None = None,
) -> WindowAnswers:
    """The detector's answers to the whole windows of a camera, those in [start_us, end_us) if given.

    Those so far when `cancelled()` becomes true. `reasons` counts why the windows without a ball have none.

    Args:
        stream: the camera's events.
        detector: is reset first.
        window_us: length of a window, or the rule by which windows end.
        start_us: where the first window begins.
        end_us: where the last one ends at most; None: the end of the recording.
        progress: gets the share that is done.
        cancelled: asked before each window.
        reasons: counts, changed in place.
    """
    end_us = duration_of(stream) if end_us is None else end_us
    rule, motion = window_us if isinstance(window_us, WindowRule) else WindowRule(longest_us=window_us), ImageMotion()
    windows = windows_by_rule(stream, start_us, end_us, rule, motion)
    between = start_us, end_us
    return answer_windows(
        detector, windows, between, progress=progress, cancelled=cancelled, reasons=reasons, motion=motion
    )


def run_on_frames(
    frames: FrameStream,
    detector: Detector,
    *,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    reasons: ReasonCounter | None = None,
) -> WindowAnswers:
    """Run a detector over the pictures of a frame camera; a window is one exposure, without events."""
    between = (0, int(frames.t_us[-1])) if len(frames) else (0, 0)
    windows = frame_windows(frames)
    return answer_windows(detector, windows, between, progress=progress, cancelled=cancelled, reasons=reasons)


def answer_windows(
    detector: Detector,
    windows: Iterable[Window],
    between_us: tuple[int, int],
    *,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    reasons: ReasonCounter | None = None,
    motion: ImageMotion | None = None,
) -> WindowAnswers:
    """A detector's answers to windows in order of time, which lie between these two times; `motion` is given each."""
    detector.reset()
    start_us, end_us = between_us
    rows: list[tuple[int, int, float, float, float, int]] = []
    detections: list[Detection] = []
    for number, window in enumerate(windows):
        found = detector.step(window)
        if motion is not None:
            motion.add(found)
        place = (window.end_us if window.frame is None else window.frame.t_us, np.nan, np.nan, np.nan)
        if found is not None:
            place = (found.t_us, found.u_px, found.v_px, found.r_px)
            detections.append(found)
        elif reasons is not None:
            reasons.add(reasons_of(detector))
        rows.append((window.end_us, *place, detector.extra_circles))
        # A window of events takes less time than asking; a picture through a network takes much more.
        if number % (REPORT_EVERY if window.frame is None else 1) == 0:
            if cancelled is not None and cancelled():
                break
            if progress is not None and end_us > start_us:
                progress(min(1.0, (window.end_us - start_us) / (end_us - start_us)))
    end, t, u, v, r, extra = zip(*rows, strict=True) if rows else ((),) * 6
    return WindowAnswers(
        end_us=np.array(end, np.int64),
        t_us=np.array(t, np.int64),
        u_px=np.array(u, np.float64),
        v_px=np.array(v, np.float64),
        r_px=np.array(r, np.float64),
        extra_circles=np.array(extra, np.int32),
        detections=tuple(detections),
    )


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
    trace: MethodTrace | None = None
    """What each stage kept, from `explain_window`."""
    reasons: tuple[Reason, ...] = ()
    """Why there is no ball, where that was asked for; empty with one."""

    @property
    def valid_us(self) -> int:
        """Time at which the answer is valid; the end of the window without one."""
        return self.detection.t_us if self.detection else self.window.end_us


def answer_window(
    stream: CameraStream,
    method: Method,
    config: DetectorConfig,
    t_us: int,
    *,
    lead_in_us: int = LEAD_IN_US,
    why_not: bool = False,
) -> WindowAnswer:
    """Run a method over the time before `t_us` and give its answer to the window that ends there.

    At the very start of a recording the window is the first whole one. `why_not`: ask why there is no ball, which takes
    some methods as long as a step.
    """
    detector, window, lead_in = _led_in(stream, method, config, t_us, lead_in_us)
    ball = detector.step(window)
    reasons = reasons_of(detector) if why_not and ball is None else ()
    return WindowAnswer(method, window, ball, lead_in, reasons=reasons)


LEAD_IN_WINDOWS: Final = 25
"""Fewest windows before one that is explained: the region and the polarity are then those of a live run."""


def explain_window(stream: CameraStream, method: Method, config: DetectorConfig, t_us: int) -> WindowAnswer:
    """Like `answer_window`, with the trace of that window and, for long windows, with more of the time before."""
    window_us = method_config(method, config).window.window_us
    lead_in = max(LEAD_IN_US // window_us, LEAD_IN_WINDOWS)
    # `refined` searches its longest time span in every fourth window only: this window is such a one.
    lead_in_us = window_us * (lead_in + -(lead_in + 1) % SEARCH_EVERY[-1])
    detector, window, lead_in = _led_in(stream, method, config, t_us, lead_in_us)
    trace = explain_step(detector, window)
    return WindowAnswer(method, window, trace.detection, lead_in, trace, trace.reasons)


def _led_in(
    stream: CameraStream, method: Method, config: DetectorConfig, t_us: int, lead_in_us: int
) -> tuple[Detector, Window, int]:
    """A detector that has processed the windows before, the window that ends at `t_us`, and how many those are."""
    window_us = method_config(method, config).window.window_us
    end_us = max(t_us, window_us)
    lead_in = min(lead_in_us, end_us - window_us) // window_us
    detector = make_detector(method, stream.sensor, config)
    return detector, step_before(detector, stream, end_us, window_us, lead_in), lead_in


def step_before(detector: Detector, stream: CameraStream, end_us: int, window_us: int, windows: int) -> Window:
    """Step a detector through so many windows of a camera before the one that ends at `end_us`; returns that one."""
    start_us = end_us - window_us
    before_us = start_us - windows * window_us
    events = stream.slice(before_us, start_us)
    for first_us in range(before_us, start_us, window_us):
        detector.step(Window(events.between(first_us, first_us + window_us), first_us, first_us + window_us))
    return Window(stream.slice(start_us, end_us), start_us, end_us)  # a copy, as it may be cached


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

    def why_not(self) -> tuple[Reason, ...]:
        """Why the detector's last window had no ball; its time is not measured."""
        return reasons_of(self._detector)

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


STRETCHES: Final = 6
STRETCH_US: Final = 50_000
"""Length of a stretch that is counted."""
SAMPLE_LEAD_IN_US: Final = 40_000
"""Time before it in which a detector may lock on: `refined` confirms a ball within 10 to 40 ms."""


@dataclass(frozen=True, slots=True)
class MethodSample:
    """What a method found in a sample of a recording."""

    method: Method
    windows: int
    found: int
    """Windows with a ball."""
    reasons: tuple[ReasonCount, ...]
    """Why the others have none, the most frequent reason first."""

    @property
    def share(self) -> float:
        """Share of the windows with a ball; 0 without windows."""
        return self.found / self.windows if self.windows else 0.0


def sample_method(
    stream: CameraStream, method: Method, config: DetectorConfig, span_us: tuple[int, int] | None = None
) -> MethodSample:
    """Run a method over `STRETCHES` stretches of a camera, evenly spread over a span, by default the whole recording.

    A span that is shorter than these is run as a whole.
    """
    settings = method_config(method, config)
    window_us, (first_us, last_us) = settings.window.window_us, span_us or (0, duration_of(stream))
    counter, windows, found = ReasonCounter(), 0, 0
    detector = make_detector(method, stream.sensor, settings)
    for start_us, stop_us in _stretches(first_us, last_us):
        run_detector(stream, detector, window_us, start_us=max(first_us, start_us - SAMPLE_LEAD_IN_US), end_us=start_us)
        answers = run_detector(stream, _Going(detector), window_us, start_us=start_us, end_us=stop_us, reasons=counter)
        windows += len(answers.end_us)
        found += int(answers.detected.sum())
    return MethodSample(method, windows, found, counter.counts())


def best_other(
    stream: CameraStream,
    method: Method,
    configs: Mapping[Method, DetectorConfig],
    span_us: tuple[int, int] | None = None,
) -> MethodSample | None:
    """The sample of the other method that finds a ball most often; None if none does."""
    others = [sample_method(stream, other, config, span_us) for other, config in configs.items() if other != method]
    best = max(others, key=lambda one: one.share, default=None)
    return best if best is not None and best.found else None


def sample_rimless(
    stream: CameraStream, span_us: tuple[int, int] | None = None, *, defaults_fail: bool = False
) -> MethodSample | None:
    """The sample of `refined` with the settings of `RIMLESS`; None if its defaults find a ball, or these do not.

    `defaults_fail`: it is known already that a sample with the defaults finds none.
    """
    rimless = load_detector(RIMLESS)
    if not defaults_fail and sample_method(stream, rimless.method, method_config(rimless.method), span_us).found:
        return None
    sample = sample_method(stream, rimless.method, rimless.config, span_us)
    return sample if sample.found else None


def _stretches(first_us: int, last_us: int) -> list[tuple[int, int]]:
    """Start and end of each stretch of a span."""
    if last_us - first_us <= STRETCHES * STRETCH_US:
        return [(first_us, last_us)]
    gap_us = (last_us - first_us - STRETCH_US) // (STRETCHES - 1)
    return [(start_us, start_us + STRETCH_US) for start_us in range(first_us, last_us, gap_us)][:STRETCHES]


class _Going:
    """A detector that goes on from where it is: a run would reset it."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector

    @property
    def extra_circles(self) -> int:
        """Further circles that the detector found."""
        return self._detector.extra_circles

    def reset(self) -> None:
        """Do nothing."""

    def step(self, window: Window) -> Detection | None:
        """Answer of the detector."""
        return self._detector.step(window)

    def why_not(self) -> tuple[Reason, ...]:
        """Why the last window had no ball."""
        return reasons_of(self._detector)
