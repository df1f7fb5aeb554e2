"""What a recording offers, whether it is a file or still growing: time slices of each camera and what is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.events import Events, SensorSize
from core.recordings.truth import BallTruth, PixelTruth


@dataclass(frozen=True, slots=True, eq=False)
class Triggers:
    """External trigger edges, t_us ascending; an edge just before the first event has a negative time."""

    t_us: NDArray[np.int64]
    rising: NDArray[np.bool_]
    channel: NDArray[np.int16]


class CameraStream(Protocol):
    """One camera of a recording."""

    @property
    def name(self) -> str: ...
    @property
    def sensor(self) -> SensorSize: ...
    @property
    def event_count(self) -> int: ...
    @property
    def calibration(self) -> Camera | None: ...
    @property
    def triggers(self) -> Triggers: ...
    @property
    def truth(self) -> PixelTruth | None:
        """Where the ball is in this camera's picture, if the recording knows."""
        ...

    def slice(self, start_us: int, end_us: int) -> Events:
        """The events with `start_us <= t < end_us`; cost grows with the slice, not with the recording."""
        ...

    def counts_per_ms(self) -> NDArray[np.int64]:
        """Events in each whole millisecond of the recording, from the index and not from the events."""
        ...


class Recording(Protocol):
    """All cameras on one clock that starts at 0 us. Safe to read from several threads."""

    @property
    def uuid(self) -> str: ...
    @property
    def duration_us(self) -> int:
        """Every event's time is below it."""
        ...

    @property
    def cameras(self) -> dict[str, CameraStream]: ...
    @property
    def ball(self) -> BallTruth | None: ...
    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know: where a damaged source stopped, what was repaired, what was assumed."""
        ...

    def close(self) -> None:
        """Let go of the file, if there is one; what was sliced out of it stays valid."""
        ...

    def __enter__(self) -> Self:
        """Every recording closes itself at the end of a `with` block."""
        ...

    def __exit__(self, *_: object) -> None: ...


def knows_ball(recording: Recording) -> bool:
    """Whether it says where the ball truly is, in the world or in one of its cameras."""
    return recording.ball is not None or any(stream.truth is not None for stream in recording.cameras.values())


def calibrations_of(recording: Recording) -> dict[str, Camera]:
    """Lens and pose of the event cameras that have them, by name."""
    return {name: one.calibration for name, one in recording.cameras.items() if one.calibration is not None}


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
