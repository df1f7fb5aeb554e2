"""The newest pictures of an ordinary camera of a live source, as the frames that a file offers."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import LinkError, RecordingError
from core.events import CameraFrame
from core.recordings.frames import FrameStream, end_of


class PictureRing:
    """Pictures of one camera up to a number of bytes, the oldest forgotten first. Thread-safe."""

    def __init__(self, calibration: Camera | None, most_bytes: int) -> None:
        """The newest picture is kept, however large."""
        self._calibration, self._most_bytes = calibration, most_bytes
        self._lock = threading.Lock()
        self._frames: deque[CameraFrame] = deque()
        self._first = self._bytes = 0
        self._stream: FrameStream | None = None

    def add(self, frame: CameraFrame) -> None:
        """One picture more.

        Raises:
            LinkError: if it is older than the one before.
        """
        with self._lock:
            if self._frames and frame.t_us < self._frames[-1].t_us:
                raise LinkError("pictures run backwards", got=f"{frame.t_us} us", where="picture")
            self._frames.append(frame)
            self._bytes += frame.image.nbytes
            while self._bytes > self._most_bytes and len(self._frames) > 1:
                self._forget_oldest()
            self._stream = None

    def forget_before(self, t_us: int) -> None:
        """Drop pictures whose exposure was over at a time."""
        with self._lock:
            while self._frames and end_of(self._frames[0]) <= t_us:
                self._forget_oldest()

    def stream(self) -> FrameStream:
        """What is remembered now. It holds no pictures: one that is forgotten meanwhile cannot be read any more."""
        with self._lock:
            if self._stream is None:
                t_us = np.fromiter((frame.t_us for frame in self._frames), np.int64)
                exposure_us = np.fromiter((frame.exposure_us for frame in self._frames), np.int64)
                pictures = _Remembered(self, self._first)
                self._stream = FrameStream(pictures, t_us, exposure_us, self._calibration, first=self._first)
            return self._stream

    def image(self, number: int) -> NDArray[np.uint8]:
        """A picture by its number since the session began.

        Raises:
            RecordingError: if it is forgotten.
        """
        with self._lock:
            row = number - self._first
            if not 0 <= row < len(self._frames):
                raise RecordingError("this picture is no longer in memory", got=number)
            return self._frames[row].image

    def _forget_oldest(self) -> None:
        self._bytes -= self._frames.popleft().image.nbytes
        self._first += 1
        self._stream = None


class _Remembered:
    """Rows of a stream, from the number of its first one on."""

    def __init__(self, ring: PictureRing, first: int) -> None:
        self._ring, self._first = ring, first

    def __getitem__(self, row: int, /) -> NDArray[np.uint8]:
        return self._ring.image(self._first + row)
