"""Makes a recording of ours out of event files of others: any number, a camera or more in each."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.plausible import odd_poses
from core.cameras.units import check_lengths
from core.errors import CalibrationError, RecordingError
from core.events import Events, SensorSize
from core.events.clock_table import ClockTable
from core.recordings.frame_import import FRAME_CAMERA, FrameInput, first_image_size, read_frame_times, read_images
from core.recordings.identity import files_of, source_uuid
from core.recordings.import_facts import EventCounts, ImportFacts, SourceFacts, source_facts, unused_options
from core.recordings.recording import Triggers
from core.recordings.sources import EventSource, open_sources
from core.recordings.sources.folders import camera_names
from core.recordings.sources.piped_sources import pipes_read_once
from core.recordings.sources.source import DecodeReport, PictureTrack, Stated, Whence
from core.recordings.truth import BallTruth
from core.recordings.writer import RecordingWriter
from core.text import encodable

_FLUSH_S: Final = 1.0
"""What a killed import may lose."""
_FARTHEST_US: Final = 1 << 61
"""Largest offset between clocks: sums with times of files stay within 64 bits."""
_UNRELATED_US: Final = 3_600_000_000
"""Clocks of the cameras of one rig are not further apart than this."""


@dataclass(frozen=True, slots=True)
class ImportSummary:
    """What an import made."""

    path: Path
    events: dict[str, int]
    """Per camera."""
    triggers: dict[str, int]
    duration_us: int
    notes: tuple[str, ...]
    facts: ImportFacts


@dataclass(slots=True)
class _Feed:
    """One camera on its way in."""

    name: str
    source: EventSource
    clock_us: int
    """Added to the source's times to get those of the first source."""
    weight: float
    file: str
    clock: ClockTable | None = None
    """Added to that, where the difference changes."""
    report: DecodeReport = field(default_factory=DecodeReport)
    parts: Iterator[Events] = field(init=False)
    pending: Events | None = field(init=False)
    first_us: int | None = field(init=False)
    last_us: int = 0
    triggers: int = 0
    last_trigger_us: int | None = None
    counts: EventCounts = field(default_factory=EventCounts)

    def __post_init__(self) -> None:
        self.parts = self.source.read(self.report)
        self.pending = next(self.parts, None)
        self.first_us = None if self.pending is None else int(self.common_us(self.pending.t_us[:1])[0])

    def common_us(self, t_us: NDArray[np.int64]) -> NDArray[np.int64]:
        """Times of the source on the clock of the first one."""
        return (t_us if self.clock is None else self.clock.shifted(t_us)) + self.clock_us

    def count(self, part: Events) -> None:
        """Take in a part that is imported."""
        counts, events = self.counts, len(part)
        if events:
            first_us = int(part.t_us[0]) if counts.first_us is None else counts.first_us
            on = counts.on + int(np.count_nonzero(part.on))
            self.counts = dataclasses.replace(
                counts, events=counts.events + events, on=on, first_us=first_us, last_us=int(part.t_us[-1])
            )


@dataclass(frozen=True, slots=True)
class _Plan:
    """What is to be imported, when the files are open."""

    sources: Sequence[Path]
    feeds: list[_Feed]
    zero_us: int
    """Time 0 of the recording, on the clock of the first source."""
    sensors: dict[str, SensorSize]
    calibration: dict[str, Camera]
    given: frozenset[str]
    """Cameras whose calibration is not from the files."""
    frames: FrameInput | None
    remarks: Sequence[str]

    def facts(self, *, complete: bool) -> ImportFacts:
        """What has been found up to now."""
        duration_us = max((feed.last_us + 1 for feed in self.feeds if feed.counts.events), default=0)
        notes = _notes(self.feeds, self.sources, self.remarks)
        return ImportFacts(tuple(map(self._camera, self.feeds)), duration_us, complete, notes)

    def _camera(self, feed: _Feed) -> SourceFacts:
        known = feed.name in self.calibration
        whence = Whence.OPTION if feed.name in self.given else Whence.FILE
        counts = dataclasses.replace(feed.counts, triggers=feed.triggers)
        return source_facts(
            feed.source, feed.report, counts,
            name=feed.name, file=feed.file, calibration_from=whence if known else None,
        )  # fmt: skip


@pipes_read_once
def import_recording(
    sources: Sequence[Path],
    destination: Path,
    *,
    names: Sequence[str] | None = None,
    sensor: SensorSize | Sequence[SensorSize] | None = None,
    calibration: Mapping[str, Camera] | None = None,
    offset_us: int | Sequence[int] = 0,
    clock: ClockTable | Sequence[ClockTable] | None = None,
    remarks: Sequence[str] = (),
    stated: Stated | None = None,
    frames: FrameInput | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> ImportSummary | None:
    """Write the recording and say what is in it; None if `cancelled` said so, and then no file is left.

    Time 0 is the first event. `offset_us` is added to the times of a source to get the clock of the first: one number
    for each source (or for each camera of a single source), or a single one for all after the first. Where that
    difference changes, a `clock` for each source after the first says how. A `sensor` for each source overrides what
    the files say, a single one is for all. The recording's notes begin with the `remarks`.
    The clock of each camera is kept: its own time is the recording's plus its `t_offset`.

    Raises:
        RecordingError: if a source cannot be read at all, or the recording cannot be written.
    """
    if any(destination.exists() and path.exists() and destination.samefile(path) for path in sources):
        raise RecordingError("the recording would replace its own source", where=destination)
    if destination.exists() and not overwrite:  # found before long work on the sources
        raise RecordingError("the file exists", where=destination, remedy="choose another name, or --force")
    feeds = _open_feeds(sources, names, sensor, offset_us, clock, stated or Stated())
    plan = _plan(sources, feeds, calibration or {}, frames, remarks)
    uuid = imported_uuid(sources, list(plan.sensors), sensor=sensor, offset_us=offset_us, clock=clock, stated=stated)
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError("cannot make the folder", got=error.strerror, where=destination.parent) from error
    writer: RecordingWriter | None = None
    try:
        writer = RecordingWriter(
            destination,
            plan.sensors,
            calibration=plan.calibration,
            time_offsets_us={feed.name: plan.zero_us - feed.clock_us for feed in feeds},
            uuid=uuid,
            overwrite=overwrite,
        )
        if not _copy_events(writer, plan, progress, cancelled):
            writer.discard()
            return None
        _copy_pictures(writer, plan)
        facts = plan.facts(complete=True)
        for note in facts.notes:
            writer.note(note)
        writer.close()
    except BaseException as error:
        if writer is None:
            if isinstance(error, KeyboardInterrupt):  # while the file was being made
                destination.unlink(missing_ok=True)
        elif writer.failed:  # the disk is full: what is there may be of use
            writer.close()
        else:
            writer.discard()
        raise
    if progress is not None:
        progress(1.0)
    events = {feed.name: writer.event_count(feed.name) for feed in feeds}
    triggers = {feed.name: feed.triggers for feed in feeds}
    return ImportSummary(destination, events, triggers, writer.duration_us, facts.notes, facts)


def imported_uuid(
    sources: Sequence[Path],
    cameras: Sequence[str],
    *,
    sensor: SensorSize | Sequence[SensorSize] | None = None,
    offset_us: int | Sequence[int] = 0,
    clock: ClockTable | Sequence[ClockTable] | None = None,
    stated: Stated | None = None,
) -> str:
    """Identity of the recording that `import_recording` makes with the same arguments; `cameras` are its names."""
    details = _text(sensor) + "".join(one.digest for one in _clocks(clock)) + _choices(stated)
    return source_uuid(sources, list(cameras), details, _one_number(offset_us))


@pipes_read_once
def check_import(
    sources: Sequence[Path],
    *,
    names: Sequence[str] | None = None,
    sensor: SensorSize | Sequence[SensorSize] | None = None,
    calibration: Mapping[str, Camera] | None = None,
    offset_us: int | Sequence[int] = 0,
    clock: ClockTable | Sequence[ClockTable] | None = None,
    remarks: Sequence[str] = (),
    stated: Stated | None = None,
    frames: FrameInput | None = None,
    longest_s: float | None = None,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> ImportFacts | None:
    """What `import_recording` would find with the same arguments; nothing is written. None if `cancelled` said so.

    After `longest_s` seconds of reading events the rest is left unread, and the facts say so.

    Raises:
        RecordingError: what the import would raise on reading.
    """
    feeds = _open_feeds(sources, names, sensor, offset_us, clock, stated or Stated())
    plan = _plan(sources, feeds, calibration or {}, frames, remarks)
    end_s = None if longest_s is None else time.monotonic() + longest_s

    def over() -> bool:
        return (cancelled is not None and cancelled()) or (end_s is not None and time.monotonic() > end_s)

    complete = _copy_events(None, plan, progress, over)
    if cancelled is not None and cancelled():
        return None
    if complete:
        _copy_pictures(None, plan)
        if progress is not None:
            progress(1.0)
    return plan.facts(complete=complete)


def _plan(
    sources: Sequence[Path],
    feeds: list[_Feed],
    calibration: Mapping[str, Camera],
    frames: FrameInput | None,
    remarks: Sequence[str],
) -> _Plan:
    zero_us = _common_zero(feeds)
    sensors = {feed.name: feed.source.sensor for feed in feeds}
    _refuse_turned(sensors)
    if calibration or frames is not None:
        _refuse_assumed_sizes(feeds)
    own, odd = _own_calibration(feeds, calibration)
    given = _match_calibration(calibration, list(sensors))
    remarks = [*remarks, *odd, *_unmatched(calibration, own | given, list(sensors)), *_exchanged(sources, feeds)]
    for name, pictures in _pictures_of(feeds):
        sensors.setdefault(name, pictures.sensor)
    if frames is not None:
        sensors[FRAME_CAMERA] = first_image_size(frames.images)
    return _Plan(sources, feeds, zero_us, sensors, own | given, frozenset(given), frames, remarks)


def _open_feeds(
    paths: Sequence[Path],
    names: Sequence[str] | None,
    sensor: SensorSize | Sequence[SensorSize] | None,
    offset_us: int | Sequence[int],
    clock: ClockTable | Sequence[ClockTable] | None,
    stated: Stated,
) -> list[_Feed]:
    if not paths:
        raise RecordingError("no sources", expected="an event file or more")
    for place, path in enumerate(paths):
        if any(path.exists() and other.exists() and path.samefile(other) for other in paths[:place]):
            remedy = "each camera has its own file"
            raise RecordingError("the same file is given twice", where=path, remedy=remedy)
    far = [one for one in ([offset_us] if isinstance(offset_us, int) else offset_us) if abs(one) > _FARTHEST_US]
    if far:
        raise RecordingError("no such offset", expected=f"at most {_FARTHEST_US} us", got=far[0], where="--offset-us")
    sizes = [*sensor] if isinstance(sensor, Sequence) else [sensor] * len(paths)
    if len(sizes) != len(paths):
        raise RecordingError("not a sensor size for each source", expected=len(paths), got=len(sizes))
    opened = [(number, source) for number, path in enumerate(paths) for source in open_sources(path, sizes[number])]
    if names is None:
        names = _names(paths, opened)
    if len(names) != len(opened) or len(set(names)) != len(names):
        remedy = "give --names"
        raise RecordingError(
            "the names do not fit", expected=f"{len(opened)} different ones", got=",".join(names), remedy=remedy
        )
    offsets_us = _offsets_us(offset_us, [number for number, _ in opened])
    clocks = _clocks(clock)
    if len(clocks) not in (0, 1, len(paths) - 1):
        raise RecordingError("not a table of clocks for each further source", expected=len(paths) - 1, got=len(clocks))
    of_source: list[ClockTable | None] = [None, *(clocks * (len(paths) - 1) if len(clocks) == 1 else clocks)]
    of_source += [None] * (len(paths) - len(of_source))
    weights = [sum(file.stat().st_size for file in files_of(paths[number])) for number, _ in opened]
    return [
        _Feed(
            name,
            source,
            offsets_us[place],
            weights[place] / max(1, sum(weights)),
            paths[number].name,
            of_source[number],
            DecodeReport(stated=stated),
        )
        for place, (name, (number, source)) in enumerate(zip(names, opened, strict=True))
    ]


def _names(paths: Sequence[Path], opened: Sequence[tuple[int, EventSource]]) -> Sequence[str]:
    """What the sources call their cameras; of files that do not say it, what the files are called."""
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


def _one_number(offset_us: int | Sequence[int]) -> int | tuple[int, ...]:
    """The offsets as part of the recording's identity: `0,N` of a pair is N."""
    if isinstance(offset_us, int):
        return offset_us
    return offset_us[1] if len(offset_us) == 2 and not offset_us[0] else tuple(offset_us)


def _clocks(clock: ClockTable | Sequence[ClockTable] | None) -> list[ClockTable]:
    if clock is None:
        return []
    return [clock] if isinstance(clock, ClockTable) else list(clock)


def _text(sensor: SensorSize | Sequence[SensorSize] | None) -> str:
    return ",".join(map(str, sensor)) if isinstance(sensor, Sequence) else str(sensor)


def _choices(stated: Stated | None) -> str:
    """What was stated, as part of the recording's identity; empty if nothing was."""
    return "" if stated is None or stated == Stated() else repr(stated)


def _refuse_assumed_sizes(feeds: list[_Feed]) -> None:
    """A calibration and pictures hang on the size of the sensor: there it is not guessed."""
    for feed in feeds:
        if feed.source.sensor_from == Whence.ASSUMED:
            raise RecordingError(
                f"camera {feed.name}: the file does not name its sensor size, and a calibration or pictures hang on it",
                got=f"{feed.source.sensor}, assumed from the events",
                remedy="give --width and --height",
            )


def _refuse_turned(sensors: Mapping[str, SensorSize]) -> None:
    """Cameras of one make do not have width and height the other way round than each other.

    Raises:
        RecordingError: if they do.
    """
    for name, size in sensors.items():
        turned = SensorSize(size.height_px, size.width_px)
        other = next((other for other, its in sensors.items() if its == turned != size), None)
        if other is not None and size.height_px > size.width_px:
            got = f"{size} of camera {name}, {turned} of camera {other}"
            remedy = "give --width and --height for each source: W,W and H,H"
            raise RecordingError("width and height of a sensor are exchanged", got=got, remedy=remedy)


def _common_zero(feeds: list[_Feed]) -> int:
    """The time of the first event of all."""
    for feed in feeds:
        if feed.first_us is None and feed.report.notes:
            raise RecordingError(f"no events could be read: {feed.report.notes[-1]}")
    firsts = [feed.first_us for feed in feeds if feed.first_us is not None]
    if firsts and max(firsts) - min(firsts) > _UNRELATED_US:
        apart = " and ".join(f"{feed.name} begins at {feed.first_us} us" for feed in feeds)
        raise RecordingError("the clocks have nothing in common", got=apart, remedy="give --offset-us")
    return min(firsts, default=0)


def _match_calibration(calibration: Mapping[str, Camera], names: list[str]) -> dict[str, Camera]:
    """A calibration of one camera is for the only camera, whatever it is called; one of more may be of more cameras."""
    if len(calibration) == 1 and len(names) == 1:
        return {names[0]: next(iter(calibration.values()))}
    wanted = {name: camera for name, camera in calibration.items() if name in names}
    if wanted or not calibration:
        return wanted
    called = ",".join(calibration)
    raise RecordingError(
        "calibration of an unknown camera",
        expected=", ".join(names),
        got=called.replace(",", ", "),
        remedy=f"--names {called} if they are the same, in the order of the sources"
        if len(calibration) == len(names)
        else "--names gives the cameras the names of the calibration",
    )


def _unmatched(calibration: Mapping[str, Camera], matched: Mapping[str, Camera], names: list[str]) -> list[str]:
    """What was left out of a calibration, and whom it leaves without one."""
    if not calibration:
        return []
    left_out = [name for name in calibration if name not in names and not len(calibration) == len(names) == 1]
    lines = [f"The calibration of {', '.join(left_out)} is left out: there is no such camera."] if left_out else []
    without = [name for name in names if name not in matched]
    return [*lines, f"The calibration has no camera {', '.join(without)}."] if without else lines


def _exchanged(sources: Sequence[Path], feeds: list[_Feed]) -> list[str]:
    """A line if the files of a pair are called as the other camera."""
    if [feed.name for feed in feeds] != ["left", "right"] or len(sources) != 2:
        return []
    first, second = (path.stem.lower() for path in sources)
    if "right" in first and "left" not in first and "left" in second and "right" not in second:
        return [f"Camera left is {sources[0].name} and camera right {sources[1].name}: they may be exchanged."]
    return []


def _own_calibration(feeds: list[_Feed], given: Mapping[str, Camera]) -> tuple[dict[str, Camera], list[str]]:
    """What the files themselves say of cameras that have no `given` calibration, and what is odd or wrong about it."""
    own = {feed.name: feed.source.calibration for feed in feeds if feed.name not in given and feed.source.calibration}
    files = ", ".join(dict.fromkeys(feed.file for feed in feeds if feed.name in own))
    try:
        check_lengths(own, files)
    except CalibrationError as error:
        return {}, [f"The calibration in the files is left out: {error}; give one that is right with --calibration."]
    return own, [f"{note}." for note in odd_poses(own, own_world=False)]


def _pictures_of(feeds: list[_Feed]) -> list[tuple[str, PictureTrack]]:
    """The pictures in the files, with the name of their camera in the recording."""
    return [(pictures.name or feed.name, pictures) for feed in feeds for pictures in feed.source.pictures]


def _copy_events(
    writer: RecordingWriter | None,
    plan: _Plan,
    progress: Callable[[float], None] | None,
    cancelled: Callable[[], bool] | None,
) -> bool:
    """Read all events, the camera that is behind first, and write them if there is a writer; False if cancelled."""
    feeds, zero_us = plan.feeds, plan.zero_us
    flushed_s = time.monotonic()
    while active := [feed for feed in feeds if feed.pending is not None]:
        if cancelled is not None and cancelled():
            return False
        feed = min(active, key=_next_us)
        part = feed.pending
        assert part is not None
        t_us = feed.common_us(part.t_us) - zero_us
        t_us.flags.writeable = False
        feed.count(part)
        if writer is not None:
            writer.append(feed.name, Events(t_us, part.x_px, part.y_px, part.on, part.sensor))
        feed.last_us = int(t_us[-1])
        feed.pending = next(feed.parts, None)
        if time.monotonic() - flushed_s > _FLUSH_S:
            _copy_triggers(writer, feeds, zero_us)
            if writer is not None:
                writer.flush()
            flushed_s = time.monotonic()
        if progress is not None:
            progress(sum(feed.report.share * feed.weight for feed in feeds))
    _copy_triggers(writer, feeds, zero_us)
    return True


def _next_us(feed: _Feed) -> int:
    return 0 if feed.pending is None else int(feed.common_us(feed.pending.t_us[:1])[0])


def _copy_triggers(writer: RecordingWriter | None, feeds: list[_Feed], zero_us: int) -> None:
    for feed in feeds:
        parts, feed.report.triggers = feed.report.triggers, []
        if not parts:
            continue
        t_us = feed.common_us(np.concatenate([part.t_us for part in parts])) - zero_us
        if feed.last_trigger_us is not None:
            t_us = np.maximum(t_us, feed.last_trigger_us)
        t_us = np.maximum.accumulate(t_us)  # edges of a disordered read-out, as with events
        rising = np.concatenate([part.rising for part in parts])
        channel = np.concatenate([part.channel for part in parts])
        if writer is not None:
            writer.write_triggers(feed.name, Triggers(t_us, rising, channel))
        feed.last_trigger_us = int(t_us[-1])
        feed.triggers += len(t_us)


def _copy_pictures(writer: RecordingWriter | None, plan: _Plan) -> None:
    """Read the pictures in the files and those that were given beside them, and write them if there is a writer."""
    for feed in plan.feeds:
        for name, pictures in _pictures_of([feed]):
            for picture in pictures.read(feed.report):
                t_us = feed.common_us(np.array([picture.t_us], np.int64)) - plan.zero_us
                feed.counts = dataclasses.replace(feed.counts, pictures=feed.counts.pictures + 1)
                if writer is not None:
                    writer.write_frames(name, t_us, np.array([picture.exposure_us]), picture.image[None])
    if plan.frames is not None:
        _copy_frames(writer, plan.frames, plan.zero_us)
    _copy_reference(writer, plan)


def _copy_reference(writer: RecordingWriter | None, plan: _Plan) -> None:
    """Read the first reference of the ball that a source has, one for all cameras; write it if there is a writer."""
    for feed in plan.feeds:
        ball = None if feed.source.reference is None else feed.source.reference(feed.report)
        if ball is None:
            continue
        t_us = feed.common_us(ball.t_us) - plan.zero_us
        kept = t_us >= 0
        if kept.any():
            if writer is not None:
                p, v, spin = (column[kept] for column in (ball.p_world_m, ball.v_world_mps, ball.spin_radps))
                writer.write_ball(BallTruth(t_us[kept], p, v, spin, ball.visible[kept]))
            return


def _copy_frames(writer: RecordingWriter | None, frames: FrameInput, zero_us: int) -> None:
    times_us = read_frame_times(frames.times) - zero_us
    exposure_us = np.array([frames.exposure_us])
    count = 0
    for image in read_images(frames.images):
        if count < len(times_us) and writer is not None:
            writer.write_frames(FRAME_CAMERA, times_us[count : count + 1], exposure_us, image[None])
        count += 1
    if count != len(times_us):
        raise RecordingError(
            "frames and frame times differ in number", expected=len(times_us), got=count, where=frames.images
        )


def _notes(feeds: list[_Feed], sources: Sequence[Path], remarks: Sequence[str]) -> tuple[str, ...]:
    """What the recording keeps of its files and of what was assumed."""
    files = (" and " if len(sources) < 3 else ", ").join(path.name for path in sources)
    notes = [*remarks, f"Imported from {files} ({', '.join(dict.fromkeys(feed.source.format for feed in feeds))})."]
    for feed in feeds:
        if feed.first_us is None:
            notes.append(f"Camera {feed.name} has no events.")
        notes += [*feed.report.notes, *unused_options(feed.source, feed.report)]
    starts = [feed.first_us for feed in feeds if feed.first_us is not None]
    if len(starts) > 1 and max(starts) - min(starts) > min(feed.last_us for feed in feeds):
        notes.append("The cameras do not overlap in time; an offset between their clocks may be missing.")
    return tuple(dict.fromkeys(map(encodable, notes)))
