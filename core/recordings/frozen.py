"""A part of one camera held in memory, so that it does not go on, or is forgotten, while it is worked with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.events import Events, SensorSize
from core.recordings.recording import CameraStream, Triggers
from core.recordings.truth import PixelTruth


@dataclass(frozen=True, slots=True, eq=False)
class FrozenCamera:
    """A CameraStream with the clock of the one that it was taken from."""

    name: str
    sensor: SensorSize
    calibration: Camera | None
    truth: PixelTruth | None
    triggers: Triggers
    events: Events
    counts: NDArray[np.int64]

    @property
    def event_count(self) -> int:
        """Events that are held."""
        return len(self.events)

    def slice(self, start_us: int, end_us: int) -> Events:
        """The held events with `start_us <= t < end_us`."""
        return self.events.between(start_us, end_us)

    def counts_per_ms(self) -> NDArray[np.int64]:
        """Events in each whole millisecond, as they were counted."""
        return self.counts


def freeze_camera(stream: CameraStream, start_us: int, end_us: int) -> FrozenCamera:
    """What a camera has of [start_us, end_us) now."""
    return FrozenCamera(
        name=stream.name,
        sensor=stream.sensor,
        calibration=stream.calibration,
        truth=stream.truth,
        triggers=stream.triggers,
        events=stream.slice(start_us, end_us),
        counts=stream.counts_per_ms(),
    )
