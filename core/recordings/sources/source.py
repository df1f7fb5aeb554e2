"""What every importer gives: the sensor, the events in order, and what was seen on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.events import Events, SensorSize
from core.recordings.recording import Triggers
from core.recordings.truth import BallTruth

ASSUMED: Final = "assumed from the events"


class Columns(NamedTuple):
    """Events as a decoder finds them: not yet checked, of any integer types."""

    t_us: NDArray
    x_px: NDArray
    y_px: NDArray
    on: NDArray


class RawColumns(NamedTuple):
    """Rows of a table as the file has them: neither the unit of the times nor what the polarities mean is known."""

    t: NDArray
    x: NDArray
    y: NDArray
    p: NDArray


@dataclass(frozen=True, slots=True)
class Stated:
    """What a person says of a file that does not say it itself; None is left to the reader."""

    time_unit: str | None = None
    """One of `ns`, `us`, `ms`, `s`."""
    polarity: Mapping[str, bool] | None = None
    """Value in the file, as text -> whether it is ON."""


@dataclass(slots=True)
class DecodeReport:
    """What a decoder says beside its events; it grows while they are read."""

    share: float = 0.0
    """Of the source that has been read, 0..1."""
    notes: list[str] = field(default_factory=list)
    triggers: list[Triggers] = field(default_factory=list)
    stated: Stated = Stated()
    facts: dict[str, str] = field(default_factory=dict)
    """What was found out of the file on the way: `time unit`, `polarity`; for `import --check`."""

    def add_triggers(self, t_us: NDArray, rising: NDArray, channel: NDArray) -> None:
        """External trigger edges in the source's own time."""
        if len(t_us):
            self.triggers.append(Triggers(t_us.astype(np.int64), rising.astype(np.bool_), channel.astype(np.int16)))


class TimedPicture(NamedTuple):
    """A picture of an ordinary camera: (height, width) or (height, width, 3 = RGB)."""

    t_us: int
    """Mid exposure where that is known, on the source's own clock."""
    exposure_us: int
    """0 where the file does not tell."""
    image: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class PictureTrack:
    """The pictures in a foreign file, all of one size, in order of time."""

    name: str | None
    """Of the camera; None for the event camera itself, which takes pictures too."""
    sensor: SensorSize
    read: Callable[[DecodeReport], Iterator[TimedPicture]]


@dataclass(frozen=True, slots=True)
class EventSource:
    """The events of one camera in a foreign file. They can be read once."""

    name: str
    """Of the camera, as the file calls it, or "camera"."""
    format: str
    """For people: "Prophesee EVT3"."""
    sensor: SensorSize
    read: Callable[[DecodeReport], Iterator[Events]]
    """Sorted events in consecutive parts on the source's own clock. It tells the report how far it is, and if it has
    to stop early, why."""
    calibration: Camera | None = None
    """As the file itself tells."""
    pictures: tuple[PictureTrack, ...] = ()
    """Of this camera and of ordinary cameras on the same clock."""
    reference: Callable[[DecodeReport], BallTruth | None] | None = None
    """Where the ball is according to another instrument, in the world of `calibration`, on the source's own clock."""
    sensor_from: str = "the file"
    """Where the sensor's size is from: the file, the command line, or `ASSUMED`."""
