"""Makes a recording of ours out of event files of others: any number, a camera or more in each."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.plausible import odd_poses
from core.cameras.units import check_lengths
from core.errors import CalibrationError, RecordingError
from core.events import Events, SensorSize
from core.recordings.frame_import import FRAME_CAMERA, FrameInput, first_image_size, read_frame_times, read_images
from core.recordings.import_facts import ImportFacts, SourceFacts, source_facts, unused_options
from core.recordings.import_feeds import Feed, ImportOrder, common_zero_us, merged, open_feeds, refuse_other_unit
from core.recordings.recording import Triggers
from core.recordings.sources.piped_sources import files_of_pipes
from core.recordings.sources.source import FactOrigin
from core.recordings.truth import BallTruth
from core.recordings.writer import RecordingWriter
from core.text import encodable

_FLUSH_S: Final = 1.0
"""What a killed import may lose."""


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


class _Pictures(NamedTuple):
    """Pictures of one camera: times and exposures (N,), images (N, height, width) or (N, height, width, 3 = RGB)."""

    t_us: NDArray[np.int64]
    exposure_us: NDArray[np.int64]
    images: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class _Plan:
    """What is to be imported, when the files are open."""

    order: ImportOrder
    feeds: list[Feed]
    zero_us: int
    """Time 0 of the recording, on the clock of the first source."""
    sensors: dict[str, SensorSize]
    calibration: dict[str, Camera]
    given: frozenset[str]
    """Cameras whose calibration is not from the files."""
    remarks: Sequence[str]

    @property
    def complete(self) -> bool:
        """Whether all events were read."""
        return all(feed.pending is None for feed in self.feeds)

    @property
    def share(self) -> float:
        """Share of the sources that has been read, 0..1."""
        return sum(feed.report.share * feed.weight for feed in self.feeds)

    def facts(self) -> ImportFacts:
        """What has been found up to now."""
        duration_us = max((feed.last_us + 1 for feed in self.feeds if feed.counts.events), default=0)
        return ImportFacts(tuple(map(self._camera, self.feeds)), duration_us, self.complete, self._notes())

    def _camera(self, feed: Feed) -> SourceFacts:
        known = feed.name in self.calibration
        origin = FactOrigin.OPTION if feed.name in self.given else FactOrigin.FILE
        return source_facts(
            feed.source, feed.report, feed.counts,
            name=feed.name, file=feed.file, calibration_from=origin if known else None,
        )  # fmt: skip

    def _notes(self) -> tuple[str, ...]:
        """What the recording keeps of its files and of what was assumed."""
        sources, feeds = self.order.sources, self.feeds
        files = (" and " if len(sources) < 3 else ", ").join(path.name for path in sources)
        formats = ", ".join(dict.fromkeys(feed.source.format for feed in feeds))
        notes = [*self.remarks, f"Imported from {files} ({formats})."]
        for feed in feeds:
            if feed.first_us is None:
                notes.append(f"Camera {feed.name} has no events: {feed.file} holds none.")
            notes += [*feed.report.notes, *unused_options(feed.source, feed.report)]
        starts = [feed.first_us for feed in feeds if feed.first_us is not None]
        if len(starts) > 1 and max(starts) - min(starts) > min(feed.last_us for feed in feeds):
            notes.append("The cameras do not overlap in time; an offset between their clocks may be missing.")
        if self.order.frames is not None and starts:
            times_us = read_frame_times(self.order.frames.times) - self.zero_us
            if not ((times_us >= 0) & (times_us <= max(feed.last_us for feed in feeds))).any():
                name = self.order.frames.times.name
                notes.append(f"No picture was taken while there are events: are the times of {name} of another clock?")
        return tuple(dict.fromkeys(map(encodable, notes)))


def import_recording(
    order: ImportOrder,
    destination: Path,
    *,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> ImportSummary | None:
    """Write the recording and say what is in it; None if `cancelled` said so, and then no file is left.

    Time 0 is the first event. The clock of each camera is kept: its own time is the recording's plus its `t_offset`.

    Args:
        order: sources and how they are read.
        destination: the recording to write.
        overwrite: whether a file there may be replaced.
        progress: gets the share that is done.
        cancelled: is asked between parts.

    Raises:
        RecordingError: if a source cannot be read at all, or the recording cannot be written.
    """
    with files_of_pipes(order.sources, cancelled) as files:
        if files is None:
            return None
        order = dataclasses.replace(order, sources=files)
        _check_destination(destination, files, overwrite=overwrite)
        plan = _plan(order)
        uuid = order.uuid(list(plan.sensors))
        try:
            destination.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError("cannot make the folder", got=error.strerror, where=destination.parent) from error
        return _write(plan, destination, uuid, overwrite, progress, cancelled)


def check_import(
    order: ImportOrder,
    *,
    longest_s: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> ImportFacts | None:
    """What `import_recording` would find; nothing is written. None if `cancelled` said so.

    After `longest_s` seconds of reading events the rest is left unread, and the facts say so.

    Args:
        order: sources and how they are read.
        longest_s: how long events are read; None: all.
        progress: gets the share that is done.
        cancelled: is asked between parts.

    Raises:
        RecordingError: what the import would raise on reading.
    """
    with files_of_pipes(order.sources, cancelled) as files:
        if files is None:
            return None
        plan = _plan(dataclasses.replace(order, sources=files))
        end_s = None if longest_s is None else time.monotonic() + longest_s
        # The parts are only counted: the facts come from reading.
        for _ in _parts(plan, lambda: cancelled() or (end_s is not None and time.monotonic() > end_s)):
            progress(plan.share)
        if cancelled():
            return None
        if plan.complete:
            progress(1.0)
        return plan.facts()


def _check_destination(destination: Path, sources: Sequence[Path], *, overwrite: bool) -> None:
    """Find what can only fail before long work on the sources."""
    if any(destination.exists() and path.exists() and destination.samefile(path) for path in sources):
        raise RecordingError("the recording would replace its own source", where=destination)
    if destination.exists() and not overwrite:
        raise RecordingError("the file exists", where=destination, remedy="choose another name, or --force")


def _plan(order: ImportOrder) -> _Plan:
    feeds, calibration = open_feeds(order), order.calibration
    zero_us = common_zero_us(feeds)
    sensors = {feed.name: feed.source.sensor for feed in feeds}
    _refuse_turned(sensors)
    if calibration or order.frames is not None:
        _refuse_assumed_sizes(feeds)
    own, odd = _own_calibration(feeds, calibration)
    of_frames = {name: pictures.sensor for feed in feeds for name, pictures in feed.pictures if name not in sensors}
    if order.frames is not None:
        of_frames[FRAME_CAMERA] = first_image_size(order.frames.images)
    calibrated_frames = {name: camera for name, camera in calibration.items() if name in of_frames.keys() - sensors}
    of_events = {name: camera for name, camera in calibration.items() if name not in calibrated_frames}
    given = _match_calibration(of_events, list(sensors))
    unmatched = _unmatched(of_events, own | given, list(sensors))
    remarks = [*order.remarks, *odd, *unmatched, *_exchanged(order.sources, feeds)]
    known = own | given | calibrated_frames
    return _Plan(order, feeds, zero_us, sensors | of_frames, known, frozenset(given), remarks)


def _write(
    plan: _Plan,
    destination: Path,
    uuid: str,
    overwrite: bool,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> ImportSummary | None:
    writer: RecordingWriter | None = None
    try:
        writer = RecordingWriter(
            destination,
            plan.sensors,
            calibration=plan.calibration,
            time_offsets_us={feed.name: plan.zero_us - feed.clock_us for feed in plan.feeds},
            uuid=uuid,
            overwrite=overwrite,
        )
        flushed_s = time.monotonic()
        for camera, part in _parts(plan, cancelled):
            _write_part(writer, camera, part)
            if time.monotonic() - flushed_s > _FLUSH_S:
                writer.flush()
                flushed_s = time.monotonic()
            progress(plan.share)
        if not plan.complete:
            writer.discard()
            return None
        facts = plan.facts()
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
    progress(1.0)
    events = {feed.name: writer.event_count(feed.name) for feed in plan.feeds}
    triggers = {feed.name: feed.counts.triggers for feed in plan.feeds}
    return ImportSummary(destination, events, triggers, writer.duration_us, facts.notes, facts)


def _write_part(writer: RecordingWriter, camera: str, part: Events | Triggers | _Pictures | BallTruth) -> None:
    match part:
        case Events():
            writer.append(camera, part)
        case Triggers():
            writer.write_triggers(camera, part)
        case _Pictures():
            writer.write_frames(camera, *part)
        case BallTruth():
            writer.write_ball(part)


def _parts(plan: _Plan, stopped: Callable[[], bool]) -> Iterator[tuple[str, Events | Triggers | _Pictures | BallTruth]]:
    """All that the recording holds, with its camera: events until `stopped`, and then, if all were read, the rest."""
    for feed, part in merged(plan.feeds, plan.zero_us, stopped):
        yield feed.name, part
    if not plan.complete:
        return
    refuse_other_unit(plan.feeds)
    for feed in plan.feeds:
        for name, pictures in feed.pictures:
            for picture in pictures.read(feed.report):
                t_us = feed.common_us(np.array([picture.t_us], np.int64)) - plan.zero_us
                feed.counts = dataclasses.replace(feed.counts, pictures=feed.counts.pictures + 1)
                yield name, _Pictures(t_us, np.array([picture.exposure_us]), picture.image[None])
    if plan.order.frames is not None:
        for pictures in _frames(plan.order.frames, plan.zero_us):
            yield FRAME_CAMERA, pictures
    yield from _reference(plan)


def _frames(frames: FrameInput, zero_us: int) -> Iterator[_Pictures]:
    """The pictures that were given beside the files."""
    times_us = read_frame_times(frames.times) - zero_us
    count = 0
    for image in read_images(frames.images):
        if count < len(times_us):
            yield _Pictures(times_us[count : count + 1], np.array([frames.exposure_us]), image[None])
        count += 1
    if count != len(times_us):
        raise RecordingError(
            "frames and frame times differ in number", expected=len(times_us), got=count, where=frames.images
        )


def _reference(plan: _Plan) -> Iterator[tuple[str, BallTruth]]:
    """The first reference of the ball that a source has, one for all cameras."""
    for feed in plan.feeds:
        ball = None if feed.source.reference is None else feed.source.reference(feed.report)
        if ball is None:
            continue
        t_us = feed.common_us(ball.t_us) - plan.zero_us
        kept = t_us >= 0
        if kept.any():
            p, v, spin = (column[kept] for column in (ball.p_world_m, ball.v_world_mps, ball.spin_radps))
            yield feed.name, BallTruth(t_us[kept], p, v, spin, ball.visible[kept])
            return


def _refuse_assumed_sizes(feeds: list[Feed]) -> None:
    """A calibration and pictures hang on the size of the sensor: there it is not guessed."""
    for feed in feeds:
        if feed.source.sensor_from == FactOrigin.ASSUMED:
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


def _exchanged(sources: Sequence[Path], feeds: list[Feed]) -> list[str]:
    """A line if the files of a pair are called as the other camera."""
    if [feed.name for feed in feeds] != ["left", "right"] or len(sources) != 2:
        return []
    first, second = (path.stem.lower() for path in sources)
    if "right" in first and "left" not in first and "left" in second and "right" not in second:
        return [f"Camera left is {sources[0].name} and camera right {sources[1].name}: they may be exchanged."]
    return []


def _own_calibration(feeds: list[Feed], given: Mapping[str, Camera]) -> tuple[dict[str, Camera], list[str]]:
    """What the files themselves say of cameras that have no `given` calibration, and what is odd or wrong about it."""
    own = {feed.name: feed.source.calibration for feed in feeds if feed.name not in given and feed.source.calibration}
    files = ", ".join(dict.fromkeys(feed.file for feed in feeds if feed.name in own))
    try:
        check_lengths(own, files)
    except CalibrationError as error:
        return {}, [f"The calibration in the files is left out: {error}; give one that is right with --calibration."]
    return own, [f"{note}." for note in odd_poses(own, own_world=False)]
