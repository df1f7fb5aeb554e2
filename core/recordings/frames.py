"""Pictures of an ordinary camera that were recorded beside the events."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final, Protocol, runtime_checkable

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.events import CameraFrame, Events, SensorSize, Window
from core.recordings.hdf5 import dataset_at, hdf5_errors, place_of, read_only, read_whole
from core.recordings.recording import Recording

LARGEST_SIDE_PX: Final = 16_384
LARGEST_US: Final = 2 * 24 * 3600 * 1_000_000


class Images(Protocol):
    """Pictures by row."""

    def __getitem__(self, row: int, /) -> NDArray[np.uint8]: ...


class FrameStream:
    """Frames by number, read one at a time: those of a file from 0 on, of a live source the ones that it remembers."""

    def __init__(
        self,
        images: Images,
        t_us: NDArray[np.int64],
        exposure_us: NDArray[np.int64],
        calibration: Camera | None = None,
        *,
        first: int = 0,
        where: str = "",
        is_part: bool = False,
    ) -> None:
        """Pictures with their times.

        Args:
            images: (height, width) or (height, width, 3 = RGB) of each row.
            t_us: (N,) mid exposure, ascending.
            exposure_us: (N,) length.
            calibration: the camera's lens and pose, where they are known.
            first: number of the first row.
            where: place of the pictures, for messages.
            is_part: whether these are the pictures of a part of a stream, and no others.
        """
        self._is_part = is_part
        self._images, self._where, self.calibration, self.first = images, where, calibration, first
        self.t_us = t_us
        """(N,) mid exposure."""
        self.exposure_us = exposure_us
        """(N,) length."""

    def __len__(self) -> int:
        return len(self.t_us)

    @cached_property
    def ends_us(self) -> NDArray[np.int64]:
        """(N,) end of each exposure, as the end of its window: ascending, so that it can be searched."""
        ends_us = self.t_us - self.exposure_us // 2 + np.maximum(1, self.exposure_us)
        return np.maximum.accumulate(ends_us)  # exposures that change could overlap

    @property
    def sensor(self) -> SensorSize:
        """Size of the pictures: the calibration's, else that of the first one, of which there has to be one then."""
        if self.calibration is not None:
            return self.calibration.sensor
        height, width = self.image(self.first).shape[:2]
        return SensorSize(width, height)

    def nearest(self, t_us: int) -> int:
        """The number of the picture whose mid exposure is nearest to a time; there has to be one."""
        return self.first + int(np.argmin(np.abs(self.t_us - t_us)))

    def newest(self, t_us: int) -> int:
        """The number of the newest picture whose exposure is over at a time; -1 before the first."""
        count = int(np.searchsorted(self.ends_us, t_us, side="right"))
        return self.first + count - 1 if count else -1

    def ending_within(self, start_us: int, end_us: int) -> range:
        """Numbers of the pictures whose exposures end in (start_us, end_us]."""
        before, after = np.searchsorted(self.ends_us, (start_us, end_us), side="right").tolist()
        return range(self.first + before, self.first + after)

    def of_span(self, start_us: int, end_us: int) -> range:
        """Numbers of the pictures with a mid exposure in [start_us, end_us); all of them where they are that part.

        A part of a live source has what ended in it: the exposure of its first picture may have begun before.
        """
        if self._is_part:
            return range(self.first, self.first + len(self))
        first, after = np.searchsorted(self.t_us, (start_us, end_us)).tolist()
        return range(self.first + first, self.first + after)

    def image(self, number: int) -> NDArray[np.uint8]:
        """(height, width) or (height, width, 3 = RGB).

        Raises:
            RecordingError: if it is damaged or forgotten, or the recording closed.
        """
        with hdf5_errors(f"picture {number} cannot be read", self._where):
            return read_only(self._images[number - self.first])

    def frame(self, number: int) -> CameraFrame:
        """The picture with its times."""
        row = number - self.first
        return CameraFrame(int(self.t_us[row]), int(self.exposure_us[row]), self.image(number))


@runtime_checkable
class HasFrames(Protocol):
    """A recording that has pictures of ordinary cameras."""

    @property
    def frames(self) -> dict[str, FrameStream]:
        """By camera."""
        ...


def frames_of(recording: Recording) -> dict[str, FrameStream]:
    """Pictures of the ordinary cameras of any recording, by camera."""
    return recording.frames if isinstance(recording, HasFrames) else {}


def frames_in_memory(frames: Sequence[CameraFrame], calibration: Camera | None = None) -> FrameStream:
    """The pictures of a part of a stream, in order of time, held in memory."""
    t_us = np.array([frame.t_us for frame in frames], np.int64)
    exposure_us = np.array([frame.exposure_us for frame in frames], np.int64)
    return FrameStream([frame.image for frame in frames], t_us, exposure_us, calibration, is_part=True)


def read_frames(group: h5py.Group, calibration: Camera | None = None) -> FrameStream:
    """The frames of `/cameras/<name>/frames`, with the camera's lens and pose where they are known.

    Raises:
        RecordingError: if they are not pictures with times.
    """
    images, where = dataset_at(group, "image"), place_of(group)
    t_us, exposure_us = _read_times(group, "t_us"), _read_times(group, "exposure_us")
    shape, count = images.shape, len(t_us)
    if images.dtype != np.uint8 or not (len(shape) == 3 or (len(shape) == 4 and shape[3] == 3)):
        got = f"{images.dtype}{shape}"
        raise RecordingError("not pictures", expected="uint8 (N, height, width[, 3])", got=got, where=where)
    if not shape[0] == count == len(exposure_us):
        got = f"{shape[0]} pictures, {count} times, {len(exposure_us)} exposures"
        raise RecordingError("pictures and times differ in number", got=got, where=where)
    if count and not (0 < shape[1] <= LARGEST_SIDE_PX and 0 < shape[2] <= LARGEST_SIDE_PX):
        raise RecordingError("impossible size of a picture", got=shape[1:3], where=where)
    if (np.diff(t_us) < 0).any() or (exposure_us < 0).any():
        raise RecordingError("times of pictures run backwards", where=where)
    return FrameStream(images, t_us, exposure_us, calibration, where=where)


def _read_times(group: h5py.Group, name: str) -> NDArray[np.int64]:
    values = read_whole(dataset_at(group, name))
    if values.ndim != 1 or values.dtype.kind not in "iu" or (len(values) and np.abs(values).max() > LARGEST_US):
        expected, got = "whole microseconds", f"{values.dtype}{values.shape}"
        raise RecordingError(f"{name} of the pictures is damaged", expected=expected, got=got, where=place_of(group))
    return read_only(values.astype(np.int64))


def frame_windows(frames: FrameStream) -> Iterator[Window]:
    """A window for every picture."""
    for number in range(len(frames)):
        yield window_of(frames.frame(number))


def end_of(frame: CameraFrame) -> int:
    """End of a picture's exposure, which lasts a microsecond at least, us."""
    return frame.t_us - frame.exposure_us // 2 + max(1, frame.exposure_us)


def window_of(frame: CameraFrame) -> Window:
    """The exposure of a picture (a microsecond at least) as a window. It has no events, whatever the camera saw."""
    height, width = frame.image.shape[:2]
    start_us = frame.t_us - frame.exposure_us // 2
    return Window(Events.empty(SensorSize(width, height)), start_us, end_of(frame), frame)
