"""Pictures of an ordinary camera that were recorded beside the events."""

from __future__ import annotations

from collections.abc import Iterator

import h5py
import numpy as np
from numpy.typing import NDArray

from core.events import CameraFrame, Events, SensorSize, Window
from core.recordings.hdf5 import dataset_at, read_only


class FrameStream:
    """Frames by number, read one at a time."""

    def __init__(self, group: h5py.Group) -> None:
        self._images = dataset_at(group, "image")
        self.t_us = read_only(dataset_at(group, "t_us")[()].astype(np.int64))
        """Mid exposure."""
        self.exposure_us = read_only(dataset_at(group, "exposure_us")[()].astype(np.int64))

    def __len__(self) -> int:
        return len(self.t_us)

    def image(self, number: int) -> NDArray[np.uint8]:
        """(height, width) or (height, width, 3 = RGB)."""
        return read_only(self._images[number])

    def frame(self, number: int) -> CameraFrame:
        """The picture with its times."""
        return CameraFrame(int(self.t_us[number]), int(self.exposure_us[number]), self.image(number))


def frame_windows(frames: FrameStream) -> Iterator[Window]:
    """A window for every picture."""
    for number in range(len(frames)):
        yield window_of(frames.frame(number))


def window_of(frame: CameraFrame) -> Window:
    """The exposure of a picture (a microsecond at least) as a window. It has no events, whatever the camera saw."""
    height, width = frame.image.shape[:2]
    start_us = frame.t_us - frame.exposure_us // 2
    return Window(Events.empty(SensorSize(width, height)), start_us, start_us + max(1, frame.exposure_us), frame)
