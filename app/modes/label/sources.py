"""The cameras of a recording as Label mode sees them: event cameras and ordinary ones alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.views.frame_picture import titled_frames
from core.cameras import Camera
from core.events import Events, SensorSize
from core.recordings import CameraStream, Recording
from core.recordings.frames import FrameStream


@dataclass(frozen=True, slots=True, eq=False)
class LabelSource:
    """One camera. It has events, or frames."""

    name: str
    size: SensorSize
    stream: CameraStream | None = None
    frames: FrameStream | None = None

    @property
    def sensor(self) -> SensorSize:
        """The same as `size`: what an event camera calls it."""
        return self.size

    @property
    def calibration(self) -> Camera | None:
        """The camera model, where there is one."""
        return None if self.stream is None else self.stream.calibration

    @property
    def frames_us(self) -> NDArray[np.int64] | None:
        """Times of the frames; None for events."""
        return None if self.frames is None else self.frames.t_us

    def events(self, start_us: int, end_us: int) -> Events:
        """Events of a slice."""
        return Events.empty(self.size) if self.stream is None else self.stream.slice(start_us, end_us)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """One picture by its number."""
        assert self.frames is not None
        return self.frames.image(number)

    def frame_at(self, t_us: int) -> int | None:
        """The number of the frame nearest to a time; None for events."""
        return self.frames.nearest(t_us) if self.frames is not None and len(self.frames) else None

    def exposure(self, number: int) -> tuple[int, int]:
        """[start, end) of a frame's exposure; its time is the middle of it."""
        assert self.frames is not None
        t_us, length_us = int(self.frames.t_us[number]), max(int(self.frames.exposure_us[number]), 1)
        return max(t_us - length_us // 2, 0), max(t_us - length_us // 2, 0) + length_us


def sources_of(recording: Recording) -> dict[str, LabelSource]:
    """Every camera that can be labelled, event cameras first."""
    found = {name: LabelSource(name, stream.sensor, stream) for name, stream in recording.cameras.items()}
    for name, frames in titled_frames(recording).items():
        height, width = frames.image(0).shape[:2]
        found[name] = LabelSource(name, SensorSize(width, height), frames=frames)
    return found


def others_of(sources: Mapping[str, LabelSource], name: str) -> tuple[LabelSource, ...]:
    """The other event cameras, which see the same ball, from the next one on; none beside frames."""
    names = [each for each, source in sources.items() if source.stream is not None]
    if name not in names:
        return ()
    at = names.index(name)
    return tuple(sources[each] for each in (*names[at + 1 :], *names[:at]))
