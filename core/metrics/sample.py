"""How often a method finds a ball in a recording, and why not, from a few stretches spread over it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from core.detection import Detection, Detector, DetectorConfig
from core.detection.methods import Method, make_detector, method_config
from core.detection.reasons import Reason, ReasonCount, ReasonCounter, reasons_of
from core.events import Window
from core.metrics.run import duration_of, run_detector
from core.recordings import CameraStream

STRETCHES: Final = 6
STRETCH_US: Final = 50_000
"""Length of a stretch that is counted."""
LEAD_IN_US: Final = 40_000
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
        run_detector(stream, detector, window_us, start_us=max(first_us, start_us - LEAD_IN_US), end_us=start_us)
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
