"""The chain over a part of a recording, window by window; single detectors if it is not stereo."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from app.export.selection import Span
from core.chain import ChainConfig, ChainState, RallyChain
from core.detection import Detection, Detector, TrackState, make_detector
from core.detection.methods import method_config, states_of
from core.detection.window import windows_side_by_side
from core.events import Window
from core.history.following import is_stereo
from core.recordings import Recording, calibrations_of


@dataclass(frozen=True, slots=True, eq=False)
class ChainStep:
    """Results of one window of every camera."""

    end_us: int
    windows: dict[str, Window]
    detections: dict[str, Detection | None]
    detect_s: float
    chain: ChainState | None
    """None for a recording that cannot be triangulated."""
    before: dict[str, TrackState] | None
    """State of the detectors with stages before this window; only in every `picture_every`-th step."""


def window_length_us(config: ChainConfig) -> int:
    """Length of the detector's windows."""
    return method_config(config.method, config.detector).window.window_us


class ChainFollower:
    """The chain of some cameras; spans have to be consecutive."""

    def __init__(self, recording: Recording, config: ChainConfig, *, picture_every: int) -> None:
        self._window_us = window_length_us(config)
        self._every, self._number = picture_every, 0
        self._chain: RallyChain | None = None
        self._detectors: dict[str, Detector] = {}
        cameras = recording.cameras
        if is_stereo(recording):
            self._chain = RallyChain(calibrations_of(recording), config)
        else:
            self._detectors = {
                name: make_detector(config.method, one.sensor, config.detector) for name, one in cameras.items()
            }

    def follow(self, recording: Recording, span: Span) -> Iterator[ChainStep]:
        """Yield the steps of a span."""
        chain, detectors = self._chain, self._detectors
        for windows in windows_side_by_side(recording.cameras, span.start_us, span.end_us, self._window_us):
            self._number += 1
            end_us = next(iter(windows.values())).end_us
            before = None
            if self._number % self._every == 0:
                before = chain.track_states() if chain else states_of(detectors)
            if chain is not None:
                state = chain.step(windows)
                yield ChainStep(end_us, windows, state.detections, state.seconds.detect, state, before)
                continue
            started_s = time.perf_counter()
            found = {name: detectors[name].step(window) for name, window in windows.items()}
            yield ChainStep(end_us, windows, found, time.perf_counter() - started_s, None, before)
