"""A camera whose events are all in memory: what a detector's windows cost is then the detector's own time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.events import Events, SensorSize
from core.recordings import CameraStream, PixelTruth, Triggers


@dataclass(frozen=True, slots=True, eq=False)
class LoadedCamera:
    """One camera of a recording, read once; everything but the events is the recording's."""

    stream: CameraStream
    events: Events
    known: PixelTruth
    """Where the ball is."""

    @property
    def name(self) -> str:
        """Name of the camera."""
        return self.stream.name

    @property
    def sensor(self) -> SensorSize:
        """Sensor size of the camera."""
        return self.stream.sensor

    @property
    def event_count(self) -> int:
        """Number of events."""
        return len(self.events)

    @property
    def calibration(self) -> Camera | None:
        """Calibration of the camera."""
        return self.stream.calibration

    @property
    def triggers(self) -> Triggers:
        """Triggers of the recording."""
        return self.stream.triggers

    @property
    def truth(self) -> PixelTruth:
        """Where the ball is."""
        return self.known

    def slice(self, start_us: int, end_us: int) -> Events:
        return self.events.between(start_us, end_us)

    def counts_per_ms(self) -> NDArray[np.int64]:
        return self.stream.counts_per_ms()


def load_camera(stream: CameraStream) -> LoadedCamera:
    """Read all events of a camera of a simulated recording."""
    truth = stream.truth
    assert truth is not None, "simulated recordings know where the ball is"
    return LoadedCamera(stream, stream.slice(0, 1000 * len(stream.counts_per_ms())), truth)
