"""What is imported: files, what a person says of them, and their cameras as feeds that are merged on one clock.

The same sources imported in the same way are the same recording: labels refer to a recording by its uuid, so one that
is imported again, or opened without being imported, keeps them.
"""

from __future__ import annotations

import dataclasses
import hashlib
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.events import Events, SensorSize
from core.events.clock_table import ClockTable
from core.recordings.frame_import import FrameInput
from core.recordings.import_facts import EventCounts
from core.recordings.recording import Triggers
from core.recordings.sources import EventSource, open_sources
from core.recordings.sources.folders import camera_names
from core.recordings.sources.source import TIME_UNIT, DecodeReport, FactOrigin, ImportOptions, PictureTrack

_NAMESPACE: Final = uuid.UUID("9b1d7f5e-6a43-4d0e-9f0b-3f5d4f1f6c11")
_SAMPLES: Final = 64
_SAMPLE_BYTES: Final = 64 << 10


def files_of(path: Path) -> list[Path]:
    """The files of a source, which may be a folder."""
    return [path] if not path.is_dir() else sorted(item for item in path.rglob("*") if item.is_file())


def source_uuid(paths: Sequence[Path], *choices: object) -> str:
    """From the size and 64 samples of each file, and from the choices that change what is made of them."""
    digest = hashlib.sha256(repr(choices).encode())
    for path in [file for source in paths for file in files_of(source)]:
        size = path.stat().st_size
        digest.update(size.to_bytes(8, "little"))
        with path.open("rb") as file:
            for number in range(_SAMPLES):
                file.seek(max(0, size - _SAMPLE_BYTES) * number // (_SAMPLES - 1))
                digest.update(file.read(_SAMPLE_BYTES))
                if size <= _SAMPLE_BYTES:
                    break
    return str(uuid.uuid5(_NAMESPACE, digest.hexdigest()))


_FARTHEST_US: Final = 1 << 61
"""Largest offset between clocks: sums with times of files stay within 64 bits."""
_UNRELATED_US: Final = 3_600_000_000
"""Clocks of the cameras of one rig are not further apart than this."""

_UNIT_FACTORS: Final = (1e3, 1e6)
"""Between two units of time, of ns, us, ms and s."""
_ALIKE: Final = 2.0
"""Largest factor between what two cameras of one rig see, once their times have one unit."""
_LEAST_EVENTS: Final = 20
"""So many events or fewer tell nothing of a unit."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportOrder:
    """Files that become one recording, and what a person says of them."""

    sources: Sequence[Path]
    """Event files, or folders that are one recording."""
    _: KW_ONLY
    names: Sequence[str] | None = None
    """Names of the cameras, in the order of the sources; None: what the files call them."""
    sensor: SensorSize | Sequence[SensorSize] | None = None
    """Overrides what the files say: one size for all, or one for each source."""
    calibration: Mapping[str, Camera] = field(default_factory=dict)
    offset_us: int | Sequence[int] = 0
    """Added to the times of a source to get the clock of the first: one number for each source (or for each camera of a
    single source), or a single one for all after the first.
    """
    clock: Sequence[ClockTable] = ()
    """Where that difference changes: a table for each source after the first, or one for all of them."""
    options: ImportOptions = field(default_factory=ImportOptions)
    time_units: Sequence[str] = ()
    """Unit of the times of each source, where they differ; counts more than that of `options`."""
    frames: FrameInput | None = None
    """Pictures of an ordinary camera beside the events."""
    remarks: Sequence[str] = ()
    """The first notes of the recording."""

    def uuid(self, cameras: Sequence[str]) -> str:
        """Identity of the recording that is made of it; `cameras` are its names."""
        sensor = ",".join(map(str, self.sensor)) if isinstance(self.sensor, Sequence) else str(self.sensor)
        given = self.options
        # the text that earlier versions hashed: a recording that is imported again keeps its labels
        options = f"Stated(time_unit={given.time_unit!r}, polarity={given.polarity!r})"
        details = sensor + "".join(one.digest for one in self.clock) + ("" if given == ImportOptions() else options)
        details += ",".join(self.time_units)
        offset = self.offset_us
        if not isinstance(offset, int):  # `0,N` of a pair is N
            offset = offset[1] if len(offset) == 2 and not offset[0] else tuple(offset)
        return source_uuid(self.sources, list(cameras), details, offset)


@dataclass(slots=True, eq=False)
class Feed:
    """One camera on its way in."""

    name: str
    source: EventSource
    clock_us: int
    """Added to the source's times to get those of the first source."""
    weight: float
    """Share of the bytes of all sources."""
    file: str
    clock: ClockTable | None = None
    """Added to that, where the difference changes."""
    report: DecodeReport = field(default_factory=DecodeReport)
    parts: Iterator[Events] = field(init=False)
    pending: Events | None = field(init=False)
    first_us: int | None = field(init=False)
    last_us: int = 0
    """Time of the last event that was taken, on the recording's clock."""
    last_trigger_us: int | None = None
    counts: EventCounts = field(default_factory=EventCounts)

    def __post_init__(self) -> None:
        self.parts = self.source.read(self.report)
        self.pending = next(self.parts, None)
        self.first_us = self.next_us

    @property
    def next_us(self) -> int | None:
        """Time of the next event on the clock of the first source; None at the end."""
        return None if self.pending is None else int(self.common_us(self.pending.t_us[:1])[0])

    @property
    def pictures(self) -> list[tuple[str, PictureTrack]]:
        """The pictures in the file, with the name of their camera in the recording."""
        return [(pictures.name or self.name, pictures) for pictures in self.source.pictures]

    def common_us(self, t_us: NDArray[np.int64]) -> NDArray[np.int64]:
        """Times of the source on the clock of the first one."""
        return (t_us if self.clock is None else self.clock.shifted(t_us)) + self.clock_us

    def take(self, zero_us: int) -> Events:
        """The next part, counted, with times from `zero_us` on the clock of the first source."""
        part = self.pending
        assert part is not None
        counts = self.counts
        self.counts = dataclasses.replace(
            counts,
            events=counts.events + len(part),
            on=counts.on + int(np.count_nonzero(part.on)),
            first_us=int(part.t_us[0]) if counts.first_us is None else counts.first_us,
            last_us=int(part.t_us[-1]),
        )
        t_us = self.common_us(part.t_us) - zero_us
        t_us.flags.writeable = False
        self.last_us = int(t_us[-1])
        self.pending = next(self.parts, None)
        return Events(t_us, part.x_px, part.y_px, part.on, part.sensor)

    def take_triggers(self, zero_us: int) -> Triggers | None:
        """The trigger edges that were found since the last call; None if there are none."""
        parts, self.report.triggers = self.report.triggers, []
        if not parts:
            return None
        t_us = self.common_us(np.concatenate([part.t_us for part in parts])) - zero_us
        if self.last_trigger_us is not None:
            t_us = np.maximum(t_us, self.last_trigger_us)
        t_us = np.maximum.accumulate(t_us)  # edges of a disordered read-out, as with events
        self.last_trigger_us = int(t_us[-1])
        self.counts = dataclasses.replace(self.counts, triggers=self.counts.triggers + len(t_us))
        rising, channel = (np.concatenate([getattr(part, name) for part in parts]) for name in ("rising", "channel"))
        return Triggers(t_us, rising, channel)


def merged(
    feeds: Sequence[Feed], zero_us: int, stopped: Callable[[], bool]
) -> Iterator[tuple[Feed, Events | Triggers]]:
    """The events and trigger edges of all feeds, the camera that is behind first, up to the end or until `stopped`."""
    while (active := [feed for feed in feeds if feed.pending is not None]) and not stopped():
        feed = min(active, key=lambda one: one.next_us or 0)
        yield feed, feed.take(zero_us)
        yield from _triggers(feeds, zero_us)
    yield from _triggers(feeds, zero_us)


def _triggers(feeds: Sequence[Feed], zero_us: int) -> Iterator[tuple[Feed, Triggers]]:
    for feed in feeds:
        if (edges := feed.take_triggers(zero_us)) is not None:
            yield feed, edges


def open_feeds(order: ImportOrder) -> list[Feed]:
    """Every camera of the sources, its first events read.

    Raises:
        RecordingError: if a source cannot be read, or names, sizes, offsets or clocks do not fit the sources.
    """
    paths, sensor = order.sources, order.sensor
    _check_sources(order)
    sizes = [*sensor] if isinstance(sensor, Sequence) else [sensor] * len(paths)
    if len(sizes) != len(paths):
        raise RecordingError("not a sensor size for each source", expected=len(paths), got=len(sizes))
    units = order.time_units or [order.options.time_unit] * len(paths)
    if len(units) != len(paths):
        what, remedy = "not a unit of time for each source", "see --time-unit"
        raise RecordingError(what, expected=len(paths), got=",".join(map(str, units)), remedy=remedy)
    opened = [(number, source) for number, path in enumerate(paths) for source in open_sources(path, sizes[number])]
    names = _names(paths, opened) if order.names is None else order.names
    if len(names) != len(opened) or len(set(names)) != len(names):
        remedy = "give --names"
        raise RecordingError(
            "the names do not fit", expected=f"{len(opened)} different ones", got=",".join(names), remedy=remedy
        )
    offsets_us = _offsets_us(order.offset_us, [number for number, _ in opened])
    clocks = _clocks(order.clock, len(paths))
    # Progress by bytes: how many events a file holds is not known before.
    weights = [sum(file.stat().st_size for file in files_of(paths[number])) for number, _ in opened]
    return [
        Feed(
            name, source, offsets_us[place], weights[place] / max(1, sum(weights)), paths[number].name, clocks[number],
            DecodeReport(options=dataclasses.replace(order.options, time_unit=units[number])),
        )
        for place, (name, (number, source)) in enumerate(zip(names, opened, strict=True))
    ]  # fmt: skip


def _check_sources(order: ImportOrder) -> None:
    paths = order.sources
    if not paths:
        raise RecordingError("no sources", expected="an event file or more")
    for place, path in enumerate(paths):
        if any(path.exists() and other.exists() and path.samefile(other) for other in paths[:place]):
            remedy = "each camera has its own file"
            raise RecordingError("the same file is given twice", where=path, remedy=remedy)
    offsets = [order.offset_us] if isinstance(order.offset_us, int) else order.offset_us
    far = [one for one in offsets if abs(one) > _FARTHEST_US]
    if far:
        raise RecordingError("no such offset", expected=f"at most {_FARTHEST_US} us", got=far[0], where="--offset-us")


def _names(paths: Sequence[Path], opened: Sequence[tuple[int, EventSource]]) -> Sequence[str]:
    """What the sources call their cameras; of files that do not say it, what the files are called."""
    # Two files of one camera each are the usual stereo pair, whatever they are called.
    if len(paths) == len(opened) == 2:
        return ("left", "right")
    names = [source.name for _, source in opened]
    return names if len(set(names)) == len(names) or len(paths) < len(opened) else camera_names(paths)


def _offsets_us(offset_us: int | Sequence[int], sources: list[int]) -> list[int]:
    """What is added to the times of each camera; `sources` are the numbers of their sources."""
    if isinstance(offset_us, int):
        return [offset_us if number else 0 for number in sources]
    if len(offset_us) == len(sources):
        return list(offset_us)
    if len(offset_us) != sources[-1] + 1:
        expected = f"one number, or {sources[-1] + 1}: one for each source"
        raise RecordingError("the offsets do not fit", expected=expected, got=len(offset_us), remedy="see --offset-us")
    return [offset_us[number] for number in sources]


def _clocks(clocks: Sequence[ClockTable], count: int) -> list[ClockTable | None]:
    """The table of each of `count` sources; the first one is the clock of all."""
    if len(clocks) not in (0, 1, count - 1):
        raise RecordingError("not a table of clocks for each further source", expected=count - 1, got=len(clocks))
    further = list(clocks) * (count - 1) if len(clocks) == 1 else list(clocks) or [None] * (count - 1)
    return [None, *further]


def common_zero_us(feeds: Sequence[Feed]) -> int:
    """The time of the first event of all, on the clock of the first source.

    Raises:
        RecordingError: if nothing could be read, or the clocks have nothing in common.
    """
    for feed in feeds:
        if feed.first_us is None and feed.report.notes:
            reasons = [note for note in feed.report.notes if note not in feed.report.assumed]
            raise RecordingError(f"no events could be read: {reasons[-1] if reasons else f'{feed.file} holds none'}")
    firsts = [feed.first_us for feed in feeds if feed.first_us is not None]
    if firsts and max(firsts) - min(firsts) > _UNRELATED_US:
        apart = " and ".join(f"{feed.name} begins at {feed.first_us} us" for feed in feeds)
        remedy = "give --offset-us, or --time-unit with one for each source if their units differ"
        raise RecordingError("the clocks have nothing in common", got=apart, remedy=remedy)
    return min(firsts, default=0)


def refuse_other_unit(feeds: Sequence[Feed]) -> None:
    """The times of one file are not in a unit that is 1000 or a million times another file's.

    Then one camera would be as much longer than another, with about as many events.

    Raises:
        RecordingError: if they seem to be, and the unit of one is assumed.
    """
    seen = sorted((feed for feed in feeds if feed.counts.events > _LEAST_EVENTS), key=_span_us)
    if len(seen) < 2 or not any(_unit_is_assumed(feed) for feed in seen):
        return
    short, long = seen[0], seen[-1]
    longer = _span_us(long) / max(1, _span_us(short))
    more = long.counts.events / short.counts.events
    alike = 1 / _ALIKE < more < _ALIKE
    if alike and any(factor / _ALIKE < longer < factor * _ALIKE for factor in _UNIT_FACTORS):
        got = f"{_span_us(short) / 1e6:g} s of {short.file} and {_span_us(long) / 1e6:g} s of {long.file}"
        raise RecordingError(
            f"the times of one file are about {longer:,.0f} times those of the other, with about as many events",
            expected="times in the same unit",
            got=got,
            remedy="give --time-unit with one for each source, such as ns,us, or name it in the heading (t_ns, t_us)",
        )


def _span_us(feed: Feed) -> int:
    first_us, last_us = feed.counts.first_us, feed.counts.last_us
    return 0 if first_us is None or last_us is None else last_us - first_us


def _unit_is_assumed(feed: Feed) -> bool:
    fact = feed.report.facts.get(TIME_UNIT)
    return fact is not None and fact.origin == FactOrigin.ASSUMED
