"""A part of a live rally held in memory, so that it does not go on, or is forgotten, while it is exported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from app.export.selection import Span
from core.errors import RecordingError
from core.recordings import BallTruth, CameraStream, Recording
from core.recordings.frozen import FrozenCamera, freeze_camera


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
    streams = {name: freeze_camera(one, span.start_us, span.end_us) for name, one in recording.cameras.items()}
    frozen = RecordingSnapshot(uuid, span.end_us, streams, recording.ball, recording.notes)
    if recording.uuid != uuid:
        raise RecordingError("the live rally began anew while it was exported", remedy="export again")
    return frozen
