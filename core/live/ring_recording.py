"""The live rally as a growing recording: the last seconds of a session, with the slices that a file offers.

What Tune, Watch, Label and Export read from a file they read from here. Older events are forgotten, so memory is
bounded; times stay those of the session. A new session begins a new recording with another uuid.
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from dataclasses import dataclass, field, fields
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.config import check_settings, setting
from core.errors import LinkError
from core.events import Events, SensorSize, concatenate_events
from core.live.link import messages as m
from core.live.ring_pictures import PictureRing
from core.recordings import BallTruth, CameraStream, PixelTruth, Triggers
from core.recordings.frames import FrameStream

MIN_ROWS: Final = 1024
Columns = tuple[NDArray, ...]


class RingBuffer:
    """Pieces of rows, each with a number; the columns of all pieces in the order of their numbers.

    What was read stays as it was: rows are written behind those that are there, or all of them anew somewhere else.
    Not safe to use from several threads.
    """

    def __init__(self) -> None:
        self._numbers: list[int] = []
        self._ends: list[int] = []
        """Row behind each piece."""
        self._first = 0
        """The first row that is remembered."""
        self._columns: Columns = ()

    @property
    def columns(self) -> Columns | None:
        """Each with the rows of all pieces; None where there is no piece."""
        if not self._numbers:
            return None
        return tuple(column[self._first : self._ends[-1]] for column in self._columns)

    def put(self, number: int, piece: Columns) -> None:
        """One piece more; one with the same number is replaced."""
        if self._numbers and number <= self._numbers[-1]:
            self._put_between(number, piece)
            return
        end = self._ends[-1] if self._ends else self._first
        rows = len(piece[0])
        if not self._columns or end + rows > len(self._columns[0]):
            self._move(rows, piece)
            end = self._ends[-1] if self._ends else self._first
        for column, new in zip(self._columns, piece, strict=True):
            column[end : end + rows] = new
        self._numbers.append(number)
        self._ends.append(end + rows)

    def forget_before(self, number: int) -> None:
        """Drop blocks that are older."""
        count = bisect_left(self._numbers, number)
        if count:
            self._first = self._ends[count - 1]
            del self._numbers[:count], self._ends[:count]

    def _move(self, more: int, like: Columns) -> None:
        """Move to larger arrays."""
        kept = self.columns or tuple(column[:0] for column in like)
        rows = len(kept[0])
        room = max(MIN_ROWS, 2 * (rows + more))
        moved = tuple(np.empty((room, *column.shape[1:]), column.dtype) for column in kept)
        for column, old in zip(moved, kept, strict=True):
            column[:rows] = old
        self._ends = [end - self._first for end in self._ends]
        self._columns, self._first = moved, 0

    def _put_between(self, number: int, piece: Columns) -> None:
        """Insert a late or repeated piece."""
        pieces: dict[int, Columns] = {number: piece}
        starts = [self._first, *self._ends[:-1]]
        for known, start, end in zip(self._numbers, starts, self._ends, strict=True):
            pieces.setdefault(known, tuple(column[start:end] for column in self._columns))
        self.__init__()
        for known in sorted(pieces):
            self.put(known, pieces[known])


PIXEL_COLUMNS: Final = tuple(one.name for one in fields(PixelTruth))
BALL_COLUMNS: Final = tuple(one.name for one in fields(BallTruth))


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveConfig:
    """Size of the buffer."""

    seconds: float = setting(20.0, 1.0, 600.0)
    """Enough to step back through the last few balls."""
    events_per_camera: int = setting(20_000_000, 100_000, 200_000_000)
    """At most; 13 bytes each."""
    picture_bytes_per_camera: int = setting(400_000_000, 1_000_000, 20_000_000_000)
    """Most bytes of an ordinary camera: about 430 grey pictures of 1280x720 or 140 in colour. Events take 260 MB."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(slots=True, eq=False)
class _CameraBlocks:
    events: dict[int, Events] = field(default_factory=dict)
    truth: RingBuffer = field(default_factory=RingBuffer)
    counts: dict[int, NDArray[np.int64]] = field(default_factory=dict)
    total: int = 0

    def forget(self, block: int) -> None:
        found = self.events.pop(block, None)
        self.total -= 0 if found is None else len(found)
        self.counts.pop(block, None)


class RingRecording:
    """A Recording over a ring of blocks; a LinkListener fills it. Safe to read from several threads."""

    def __init__(self, config: LiveConfig | None = None) -> None:
        self._config = config if config is not None else LiveConfig()
        self._lock = threading.Lock()
        self._uuid, self._block_us, self._duration_us = "", 10_000, 0
        self._oldest = 0
        self._first: int | None = None
        self._sensors: dict[str, SensorSize] = {}
        self._calibration: dict[str, Camera] = {}
        self._blocks: dict[str, _CameraBlocks] = {}
        self._pictures: dict[str, PictureRing] = {}
        self._ball = RingBuffer()

    @property
    def uuid(self) -> str:
        """Identity of the session."""
        return self._uuid

    @property
    def duration_us(self) -> int:
        """Up to the last block that is complete."""
        return self._duration_us

    @property
    def start_us(self) -> int:
        """Start of the available time, us."""
        with self._lock:
            return min(self._duration_us, max(self._oldest, self._first or 0) * self._block_us)

    @property
    def cameras(self) -> dict[str, CameraStream]:
        """Cameras of the present session."""
        with self._lock:
            known = self._calibration
            return {
                name: LiveCamera(self, name, size, known.get(name), self._uuid) for name, size in self._sensors.items()
            }

    @property
    def frames(self) -> dict[str, FrameStream]:
        """Pictures of the session's ordinary cameras that are remembered, by camera."""
        with self._lock:
            rings = dict(self._pictures)
        return {name: ring.stream() for name, ring in rings.items()}

    @property
    def ball(self) -> BallTruth | None:
        """The buffered truth; None if unknown."""
        with self._lock:
            columns = self._ball.columns
        return None if columns is None else BallTruth(*columns)

    @property
    def notes(self) -> tuple[str, ...]:
        """That it is live."""
        return (f"live: the last {self._config.seconds:g} s",)

    def close(self) -> None:
        """Drop all data."""
        with self._lock:
            self._blocks = {name: _CameraBlocks() for name in self._blocks}
            self._pictures = {}
            self._ball = RingBuffer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def on_session(self, welcome: m.Reply) -> None:
        """Reset for a new session."""
        calibration = welcome.calibrated()
        sensors = {info.name: info.sensor for info in welcome.cameras}
        most_bytes = self._config.picture_bytes_per_camera
        pictures = {info.name: PictureRing(info.camera(), most_bytes) for info in welcome.frame_cameras}
        with self._lock:
            self._uuid, self._block_us, self._duration_us = welcome.session, welcome.block_us, 0
            self._sensors, self._calibration, self._oldest, self._first = sensors, calibration, 0, None
            self._blocks = {name: _CameraBlocks() for name in sensors}
            self._pictures = pictures
            self._ball = RingBuffer()

    def on_events(self, batch: m.EventBatch) -> None:
        """Keep a block of one camera; it can be seen once the state that ends it has come.

        Raises:
            LinkError: if it is not a block of one of the session's cameras.
        """
        events = batch.events()
        whole = batch.start_us % self._block_us == 0 and batch.end_us - batch.start_us == self._block_us
        if self._sensors.get(batch.camera) != events.sensor or not whole:
            raise LinkError("not a block of this session", got=batch.camera, where="events")
        block = batch.start_us // self._block_us
        edges_us = np.arange(0, self._block_us + 1000, 1000) + batch.start_us
        counts = np.diff(np.searchsorted(events.t_us, edges_us)).astype(np.int64)
        truth = batch.truth()
        with self._lock:
            store = self._blocks[batch.camera]
            store.forget(block)
            store.events[block], store.counts[block] = events, counts
            if truth is not None:
                store.truth.put(block, tuple(getattr(truth, name) for name in PIXEL_COLUMNS))
            store.total += len(events)

    def on_picture(self, picture: m.PictureMessage) -> None:
        """Keep a picture.

        Raises:
            LinkError: if it is not of one of the session's cameras, or older than the one before.
        """
        ring = self._pictures.get(picture.camera)
        if ring is None:
            raise LinkError("not a frame camera of this session", got=picture.camera, where="picture")
        ring.add(picture.frame())

    def on_state(self, state: m.WorldState) -> None:
        """The stretch up to `t_us` is complete."""
        if not state.ends_block:
            return
        truth = state.truth()
        with self._lock:
            block = state.start_us // self._block_us
            if truth is not None:
                self._ball.put(block, tuple(getattr(truth, name) for name in BALL_COLUMNS))
            self._first = block if self._first is None else self._first
            self._duration_us = max(self._duration_us, state.t_us)
            self._forget_old(int((self._duration_us - self._config.seconds * 1e6) // self._block_us))

    def on_notice(self, notice: m.Notice) -> None:
        """Nothing to keep."""

    def _forget_old(self, keep_from: int) -> None:
        newest = self._duration_us // self._block_us
        stores = self._blocks.values()
        while self._oldest < keep_from or any(store.total > self._config.events_per_camera for store in stores):
            if self._oldest >= newest:
                break
            if self._first is not None and self._oldest < self._first:
                self._oldest = self._first - 1
            for store in stores:
                store.forget(self._oldest)
            self._oldest += 1
        self._ball.forget_before(self._oldest)
        for pictures in self._pictures.values():
            pictures.forget_before(self._oldest * self._block_us)
        for store in stores:
            store.truth.forget_before(self._oldest)

    def parts(self, camera: str, uuid: str, start_us: int, end_us: int) -> list[Events]:
        """The blocks that overlap a stretch; none of a session that is over."""
        with self._lock:
            if uuid != self._uuid:
                return []
            end_us = min(end_us, self._duration_us)
            first = max(self._oldest, start_us // self._block_us)
            blocks = range(first, -(-end_us // self._block_us))
            store = self._blocks[camera].events
            return [store[block] for block in blocks if block in store]

    def truth_of(self, camera: str, uuid: str) -> PixelTruth | None:
        """Ground truth of the buffered blocks; None where there is none, and of a finished session."""
        with self._lock:
            columns = self._blocks[camera].truth.columns if uuid == self._uuid else None
        return None if columns is None else PixelTruth(*columns)

    def counts(self, camera: str, uuid: str) -> NDArray[np.int64]:
        """Events per whole millisecond of the session; 0 where they are forgotten."""
        with self._lock:
            if uuid != self._uuid:
                return np.zeros(0, np.int64)
            counts = np.zeros(self._duration_us // 1000, np.int64)
            for block, found in self._blocks[camera].counts.items():
                at = block * self._block_us // 1000
                counts[at : at + len(found)] = found[: max(0, len(counts) - at)]
            return counts


class LiveCamera:
    """A CameraStream of a live recording."""

    def __init__(
        self, recording: RingRecording, name: str, sensor: SensorSize, calibration: Camera | None, uuid: str
    ) -> None:
        self._recording, self._name, self._uuid = recording, name, uuid
        self._sensor, self._calibration = sensor, calibration

    @property
    def name(self) -> str:
        """Name of the camera."""
        return self._name

    @property
    def sensor(self) -> SensorSize:
        """Its size."""
        return self._sensor

    @property
    def event_count(self) -> int:
        """Remembered events."""
        return int(self.counts_per_ms().sum())

    @property
    def calibration(self) -> Camera | None:
        """Calibration given by the source; None where it has none."""
        return self._calibration

    @property
    def triggers(self) -> Triggers:
        """None."""
        return Triggers(np.empty(0, np.int64), np.empty(0, np.bool_), np.empty(0, np.int16))

    @property
    def truth(self) -> PixelTruth | None:
        """The buffered truth."""
        return self._recording.truth_of(self._name, self._uuid)

    def slice(self, start_us: int, end_us: int) -> Events:
        """The remembered events with `start_us <= t < end_us`."""
        parts = self._recording.parts(self._name, self._uuid, start_us, end_us)
        return concatenate_events([part.between(start_us, end_us) for part in parts], self.sensor)

    def counts_per_ms(self) -> NDArray[np.int64]:
        """Events in each whole millisecond of the session so far; 0 where they are forgotten."""
        return self._recording.counts(self._name, self._uuid)
