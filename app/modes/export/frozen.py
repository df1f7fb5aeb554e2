"""A part of a live rally held in memory, so that it does not go on, or is forgotten, while it is exported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from app.export.selection import Span
from core.cameras import Camera
from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings import BallTruth, CameraStream, PixelTruth, Recording, Triggers


@dataclass(frozen=True, slots=True, eq=False)
class FrozenCamera:
    """One camera of it."""

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


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSnapshot:
    """A Recording with the clock of the one that it was taken from."""

    uuid: str
    duration_us: int
    streams: dict[str, FrozenCamera]
    ball: BallTruth | None
    notes: tuple[str, ...]

    @property
    def cameras(self) -> dict[str, CameraStream]:
        """All cameras of the snapshot by name."""
        return dict(self.streams)

    def close(self) -> None:
        """Do nothing: a snapshot holds no file."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def freeze(recording: Recording, span: Span) -> RecordingSnapshot:
    """What the recording holds of the span now.

    Raises:
        RecordingError: if another session of the simulation began meanwhile.
    """
    uuid = recording.uuid
    streams = {
        name: FrozenCamera(
            name, one.sensor, one.calibration, one.truth, one.triggers, one.slice(span.start_us, span.end_us),
            one.counts_per_ms(),
        )
        for name, one in recording.cameras.items()
    }  # fmt: skip
    frozen = RecordingSnapshot(uuid, span.end_us, streams, recording.ball, recording.notes)
    if recording.uuid != uuid:
        raise RecordingError("the live rally began anew while it was exported", remedy="export again")
    return frozen
