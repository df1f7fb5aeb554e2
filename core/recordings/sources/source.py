"""What every importer gives: the sensor, the events in order, and what was seen on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings.recording import Triggers
from core.recordings.truth import BallTruth

TIME_UNIT: Final = "time unit"
POLARITY: Final = "polarity"
"""Names of the facts that every reader states."""


class FactOrigin(StrEnum):
    """Where a fact about a file is from."""

    FORMAT = "format"
    """The format defines it."""
    FILE = "file"
    """The file says it: in its header, its attributes, the name of a column."""
    OPTION = "option"
    """A person has said it."""
    CALIBRATION = "calibration"
    CAMERA = "camera"
    """Known of the camera that the file names."""
    DATA_SET = "data set"
    """Known of the data set that the file is recognised as; the file itself does not say it."""
    ASSUMED = "assumed"
    """Assumed from the events."""


class Fact(NamedTuple):
    """Something that was found out about a file."""

    value: str
    origin: FactOrigin
    why: str = ""
    """What was assumed and from what; empty for what is certain."""


MICROSECONDS: Final = Fact("microseconds", FactOrigin.FORMAT)
POLARITY_BIT: Final = Fact("0 = OFF, 1 = ON", FactOrigin.FORMAT)
BINARY_FACTS: Final[Mapping[str, Fact]] = MappingProxyType({TIME_UNIT: MICROSECONDS, POLARITY: POLARITY_BIT})
"""Facts about formats that define both."""


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
class ImportOptions:
    """What a person says of a file that does not say it itself; None is left to the reader."""

    time_unit: str | None = None
    """One of `ns`, `us`, `ms`, `s`."""
    polarity: Mapping[str, bool] | None = None
    """Value in the file, as text -> whether it is ON."""


def parse_polarity(text: str) -> dict[str, bool]:
    """Value in the file -> whether it is ON, from words such as `1=on,2=off`.

    Raises:
        RecordingError: if it is anything else, or states a value twice.
    """
    found: dict[str, bool] = {}
    for word in text.split(","):
        value, _, meaning = (part.strip() for part in word.rpartition("="))
        if not value or value in found or meaning.lower() not in ("on", "off"):
            raise RecordingError("not the meaning of polarities", expected="such as 1=on,2=off", got=repr(text))
        found[value] = meaning.lower() == "on"
    return found


@dataclass(slots=True)
class DecodeReport:
    """What a decoder says beside its events; it grows while they are read."""

    share: float = 0.0
    """Share of the source that has been read, 0..1."""
    notes: list[str] = field(default_factory=list)
    triggers: list[Triggers] = field(default_factory=list)
    options: ImportOptions = ImportOptions()
    facts: dict[str, Fact] = field(default_factory=dict)
    """What was found out of the file on the way, by its name (`TIME_UNIT`, `POLARITY`); for `import --check`."""
    left_out: dict[str, int] = field(default_factory=dict)
    """Reason -> how many events, words or rows were left out."""
    changed: dict[str, int] = field(default_factory=dict)
    """What was put right -> how often: times that step back a little, clocks that begin again."""
    assumed: list[str] = field(default_factory=list)
    """Those of the notes that say what the file does not."""

    def assume(self, note: str) -> None:
        """Note what had to be assumed, because the file does not say it."""
        self.assumed.append(note)
        self.notes.append(note)

    def leave_out(self, reason: str, count: int, note: str) -> None:
        """Count what is left out, and note it; nothing if there is none."""
        if count:
            self.left_out[reason] = self.left_out.get(reason, 0) + count
            self.notes.append(note)

    def change(self, what: str, count: int, note: str) -> None:
        """Count what is put right, and note it; nothing if there is none."""
        if count:
            self.changed[what] = self.changed.get(what, 0) + count
            self.notes.append(note)

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
    """Name of the camera; None for the event camera itself, which takes pictures too."""
    sensor: SensorSize
    read: Callable[[DecodeReport], Iterator[TimedPicture]]


@dataclass(frozen=True, slots=True)
class EventSource:
    """The events of one camera in a foreign file. They can be read once."""

    name: str
    """Name of the camera, as the file calls it, or "camera"."""
    format: str
    """For people: "Prophesee EVT3"."""
    sensor: SensorSize
    read: Callable[[DecodeReport], Iterator[Events]]
    """Sorted events in consecutive parts on the source's own clock. It tells the report how far it is, and if it has
    to stop early, why."""
    calibration: Camera | None = None
    """As the file itself tells."""
    pictures: tuple[PictureTrack, ...] = ()
    """Pictures of this camera and of ordinary cameras on the same clock."""
    sensor_from: FactOrigin = FactOrigin.FILE
    """Where the sensor's size is from."""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    """What is known before the first event is read; the report of the reading adds to them."""
    reference: Callable[[DecodeReport], BallTruth | None] | None = None
    """Where the ball is according to another instrument, in the world of `calibration`, on the source's own clock."""
