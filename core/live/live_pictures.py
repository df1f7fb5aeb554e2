"""The frame cameras that a live player follows beside the event cameras of a session."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final

import numpy as np

from core.cameras import Camera
from core.detection import Detection, Detector
from core.events import CameraFrame, Window
from core.live.link import messages as m
from core.recordings.frames import FrameStream, frames_in_memory, window_of

LONGEST_LOOK_S: Final = 0.04
"""Time of the source that the chain may stand still for the pictures of a block: half of what may wait for it."""
TRY_AGAIN: Final = 100
"""Blocks with pictures after which one is looked at though the last one took too long; at 30 Hz, 3 s."""


class TimedLooks:
    """A detector of pictures that measures how long a look works: waiting for the processor is not counted."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self.took_s = 0.0
        """Last look, s of the processor."""

    @property
    def extra_circles(self) -> int:
        """As the detector says."""
        return self._detector.extra_circles

    def reset(self) -> None:
        """Forget what was seen, but not how long it took."""
        self._detector.reset()

    def step(self, window: Window) -> Detection | None:
        """Look at a picture."""
        began_s = time.thread_time()
        found = self._detector.step(window)
        self.took_s = time.thread_time() - began_s
        return found


class LiveFrameCameras:
    """Calibrated frame cameras of a session with their detectors; none without a way to make one."""

    def __init__(self, make_detector: Callable[[], Detector] | None) -> None:
        self._make = make_detector
        self._detectors: dict[str, TimedLooks] = {}
        self._passed_over = 0
        self.cameras: dict[str, Camera] = {}
        """By name."""

    def begin_session(self, welcome: m.Reply) -> None:
        """Take the cameras of a session; beside fewer than two event cameras none counts, as in a file.

        Raises:
            LinkError: if a calibration is impossible.
        """
        enough = self._make is not None and len(welcome.calibrated()) > 1
        self.cameras = welcome.calibrated_frame_cameras() if enough else {}

    def warm_up(self) -> None:
        """Let each detector look at an empty picture: the first one takes longer."""
        for name, detector in self.detectors().items():
            size = self.cameras[name].sensor
            blank = CameraFrame(0, 1, np.zeros((size.height_px, size.width_px), np.uint8))
            for _ in range(2):
                detector.step(window_of(blank))

    def has_time(self, names: Collection[str], speed: float, *, tries: bool) -> bool:
        """Whether pictures of these cameras can be looked at, where `speed` seconds of the source pass in one.

        With `tries` also now and then where the last look took too long.
        """
        took_s = sum(self._detectors[name].took_s for name in names)
        self._passed_over = 0 if took_s * speed <= LONGEST_LOOK_S else (self._passed_over + 1) % TRY_AGAIN
        return self._passed_over == 0 and (tries or took_s * speed <= LONGEST_LOOK_S)

    def detectors(self) -> Mapping[str, Detector]:
        """A detector of each camera that remembers nothing. Each is made once: a network takes a second to load."""
        for name in self.cameras:
            if self._make is not None and name not in self._detectors:
                self._detectors[name] = TimedLooks(self._make())
        found = {name: self._detectors[name] for name in self.cameras}
        for detector in found.values():
            detector.reset()
        return found

    def count(self, pictures: Sequence[m.PictureMessage]) -> int:
        """How many are of these cameras."""
        return sum(one.camera in self.cameras for one in pictures)

    def streams(self, pictures: Sequence[m.PictureMessage]) -> dict[str, FrameStream]:
        """The pictures of a block, by camera."""
        frames = [(one.camera, one.frame()) for one in pictures if one.camera in self.cameras]
        return {name: frames_in_memory([frame for camera, frame in frames if camera == name]) for name in dict(frames)}
