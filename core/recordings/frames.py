"""Pictures of an ordinary camera that were recorded beside the events."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.events import CameraFrame, Events, SensorSize, Window
from core.recordings.hdf5 import dataset_at, hdf5_errors, place_of, read_only, read_whole

LARGEST_SIDE_PX: Final = 16_384
LARGEST_US: Final = 2 * 24 * 3600 * 1_000_000


class FrameStream:
    """Frames by number, read one at a time."""

    def __init__(self, group: h5py.Group, calibration: Camera | None = None) -> None:
        """The frames of `/cameras/<name>/frames`, with the camera's lens and pose where they are known.

        Raises:
            RecordingError: if they are not pictures with times.
        """
        self._images = dataset_at(group, "image")
        self._where = place_of(group)
        self.calibration = calibration
        self.t_us = self._times(group, "t_us")
        """(N,) mid exposure."""
        self.exposure_us = self._times(group, "exposure_us")
        """(N,) length."""
        shape, count = self._images.shape, len(self.t_us)
        if self._images.dtype != np.uint8 or not (len(shape) == 3 or (len(shape) == 4 and shape[3] == 3)):
            got = f"{self._images.dtype}{shape}"
            raise RecordingError("not pictures", expected="uint8 (N, height, width[, 3])", got=got, where=self._where)
        if not shape[0] == count == len(self.exposure_us):
            got = f"{shape[0]} pictures, {count} times, {len(self.exposure_us)} exposures"
            raise RecordingError("pictures and times differ in number", got=got, where=self._where)
        if count and not (0 < shape[1] <= LARGEST_SIDE_PX and 0 < shape[2] <= LARGEST_SIDE_PX):
            raise RecordingError("impossible size of a picture", got=shape[1:3], where=self._where)
        if (np.diff(self.t_us) < 0).any() or (self.exposure_us < 0).any():
            raise RecordingError("times of pictures run backwards", where=self._where)

    def _times(self, group: h5py.Group, name: str) -> NDArray[np.int64]:
        values = read_whole(dataset_at(group, name))
        if values.ndim != 1 or values.dtype.kind not in "iu" or (len(values) and np.abs(values).max() > LARGEST_US):
            expected, got = "whole microseconds", f"{values.dtype}{values.shape}"
            raise RecordingError(f"{name} of the pictures is damaged", expected=expected, got=got, where=self._where)
        return read_only(values.astype(np.int64))

    def __len__(self) -> int:
        return len(self.t_us)

    @property
    def ends_us(self) -> NDArray[np.int64]:
        """(N,) end of each exposure, as the end of its window: ascending, so that it can be searched."""
        ends_us = self.t_us - self.exposure_us // 2 + np.maximum(1, self.exposure_us)
        return np.maximum.accumulate(ends_us)  # exposures that change could overlap

    def nearest(self, t_us: int) -> int:
        """The number of the picture whose mid exposure is nearest to a time; there has to be one."""
        return int(np.argmin(np.abs(self.t_us - t_us)))

    def newest(self, t_us: int) -> int:
        """The number of the newest picture whose exposure is over at a time; -1 before the first."""
        return int(np.searchsorted(self.ends_us, t_us, side="right")) - 1

    def image(self, number: int) -> NDArray[np.uint8]:
        """(height, width) or (height, width, 3 = RGB).

        Raises:
            RecordingError: if it is damaged, or the recording closed.
        """
        with hdf5_errors(f"picture {number} cannot be read", self._where):
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
