"""The one way a recording is written: by the simulation, by imports, and live."""

from __future__ import annotations

import json
import uuid as uuids
from collections import deque
from collections.abc import Collection, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.events import CameraFrame, Events, SensorSize
from core.files import POSIX
from core.recordings import layout
from core.recordings.blocks import CHUNK_EVENTS, pack_column
from core.recordings.log.assemble import assemble
from core.recordings.log.growing import GrowingFile, Json
from core.recordings.ms_index import MsIndex
from core.recordings.recording import Triggers
from core.recordings.truth import BallTruth, PixelTruth
from core.text import encodable


class CameraBuffer:
    """The block of one camera that is being filled."""

    def __init__(self, sensor: SensorSize) -> None:
        self.sensor = sensor
        self.index = MsIndex()
        self.last_us = 0
        self.start = 0
        self.filled = 0
        self.flushed = 0
        self.columns = _empty_columns()

    def take(self, events: Events, done: int) -> int:
        """Copy events from row `done` on into the block; returns how many."""
        count = min(len(events) - done, CHUNK_EVENTS - self.filled)
        target = slice(self.filled, self.filled + count)
        for column, values in zip(self.columns, (events.t_us, events.x_px, events.y_px, events.on), strict=True):
            column[target] = values[done : done + count]
        self.filled += count
        return count

    def next_block(self) -> None:
        self.start += self.filled
        self.filled = self.flushed = 0
        self.columns = _empty_columns()


def _empty_columns() -> tuple[NDArray, ...]:
    return tuple(np.empty(CHUNK_EVENTS, dtype) for dtype in (np.int64, np.uint16, np.uint16, np.uint8))


def pack_block(columns: tuple[NDArray, ...]) -> list[bytes]:
    """The four chunks of a block, ready for HDF5."""
    return [pack_column(column, CHUNK_EVENTS) for column in columns]


_PACKERS = 2
_FLUSHES_PER_START = 100
"""The first frame of the log, without which the others mean nothing, is repeated so often, against a damaged one."""
_PENDING_BLOCKS = 12
"""Blocks on their way to the file at a time; with their packed bytes under 1 MB each."""


class RecordingWriter:
    """Writes a recording; use it as a context manager.

    Everything up to the last `flush` survives a kill of the process, and so does every full block of events before it:
    `open_recording` finds it again. Closing makes a plain HDF5 file of it. An exception inside the `with` closes the
    file too, so that what was recorded until then is kept; `discard` throws it away instead.

    One thread writes; which one does not matter.
    """

    def __init__(
        self,
        path: Path,
        cameras: Mapping[str, SensorSize],
        *,
        calibration: Mapping[str, Camera] | None = None,
        seed: int | None = None,
        config: Mapping[str, object] | None = None,
        time_offsets_us: Mapping[str, int] | None = None,
        uuid: str | None = None,
        overwrite: bool = False,
        frame_cameras: Collection[str] = (),
    ) -> None:
        """Start a recording of the named cameras.

        Args:
            path: the file.
            cameras: size of each camera's sensor, by name.
            calibration: lens and pose of some of them.
            seed: of a simulation.
            config: what made the recording.
            time_offsets_us: by camera; its own clock is the recording's plus this.
            uuid: its identity, to which labels refer; None: a new one.
            overwrite: whether a file there may be replaced.
            frame_cameras: those that take pictures only; one that never does is no event camera without events then.

        Raises:
            RecordingError: if the file exists and `overwrite` is not set, or it cannot be made.
        """
        self.path = Path(path)
        self.uuid = uuid or str(uuids.uuid4())
        _check_names(cameras, calibration or {})
        self._cameras = {name: CameraBuffer(sensor) for name, sensor in cameras.items()}
        self._last_row_us: dict[str, int] = {}
        self._row_counts: dict[str, int] = {}
        self._picture_shapes: dict[str, tuple[int, ...]] = {}
        self._duration_us = 0
        self._file = GrowingFile(self.path, overwrite=overwrite)
        # Threads do: zlib lets go of the interpreter's lock.
        self._packers = ThreadPoolExecutor(_PACKERS, thread_name_prefix="pack")
        self._pending: deque[tuple[dict[str, Json], Future[list[bytes]]]] = deque()
        self.failed = False
        """Whether the disk refused something; nothing more can be written then."""
        self._start: dict[str, Json] = {
            "kind": "start",
            "uuid": self.uuid,
            "seed": seed,
            "config": None if config is None else json.dumps(config),
            "cameras": {name: [sensor.width_px, sensor.height_px] for name, sensor in cameras.items()},
            "calibration": {name: layout.calibration_values(camera) for name, camera in (calibration or {}).items()},
            "time_offsets_us": {name: int(offset) for name, offset in (time_offsets_us or {}).items()},
            "frame_cameras": [*frame_cameras],
        }
        self._flushes = 0
        try:
            self._append_frame(self._start)
        except RecordingError:
            self.discard()
            raise

    def append(self, camera: str, events: Events) -> None:
        """Add events of one camera; their times continue those appended before.

        Raises:
            RecordingError: if time runs backwards, the sensor differs or the disk is full.
        """
        buffer = self._buffer(camera)
        if not len(events):
            return
        where = f"{self.path}, camera {camera}"
        if events.sensor != buffer.sensor:
            raise RecordingError("events of another sensor", expected=buffer.sensor, got=events.sensor, where=where)
        first_us, last_us = int(events.t_us[0]), int(events.t_us[-1])
        if first_us < buffer.last_us:
            got = f"{first_us} us after {buffer.last_us} us"
            raise RecordingError("time runs backwards", expected="times that never decrease", got=got, where=where)
        if last_us >= layout.MAX_TIME_US:
            raise RecordingError("time stamp out of range", expected="under 24 hours", got=f"{last_us} us", where=where)
        buffer.last_us = last_us
        buffer.index.extend(events.t_us)
        # The end is exclusive: the last event lies in the recording.
        self._duration_us = max(self._duration_us, last_us + 1)
        done = 0
        while done < len(events):
            done += buffer.take(events, done)
            if buffer.filled == CHUNK_EVENTS:
                self._submit(camera, buffer)

    def append_rows(self, group: str, rows: Mapping[str, NDArray]) -> None:
        """Add rows to the columns of a group such as "/racket"; a column named t or t_us must never decrease.

        The first call settles names, types and row shapes.
        """
        rows = {name: np.ascontiguousarray(column) for name, column in rows.items()}
        count = layout.check_rows(rows, where=f"{self.path}, {group}")
        if not count:
            return
        for name in ("t", "t_us"):
            if name in rows:
                first_us, last_us = int(rows[name][0]), int(rows[name][-1])
                if first_us < self._last_row_us.get(group, first_us):
                    raise RecordingError("time runs backwards", got=f"{first_us} us", where=f"{self.path}, {group}")
                self._last_row_us[group] = last_us
        columns: list[Json] = [[name, column.dtype.str, list(column.shape[1:])] for name, column in rows.items()]
        packed = [pack_column(column, count) for column in rows.values()]
        sizes: list[Json] = [len(part) for part in packed]
        start = self._row_counts.get(group, 0)
        meta: dict[str, Json] = {"kind": "rows", "group": group, "columns": columns, "start": start, "count": count}
        self._append_frame({**meta, "sizes": sizes}, packed)
        self._row_counts[group] = start + count

    def write_triggers(self, camera: str, triggers: Triggers) -> None:
        """Add external trigger edges of one camera."""
        self._buffer(camera)
        self.append_rows(layout.triggers_group(camera), layout.trigger_rows(triggers))

    def write_truth(self, camera: str, truth: PixelTruth) -> None:
        """Add samples of where the ball is in one camera's picture."""
        self._buffer(camera)
        self.append_rows(layout.truth_group(camera), layout.pixel_truth_rows(truth))

    def write_ball(self, ball: BallTruth) -> None:
        """Add samples of the ball in the world."""
        self.append_rows(layout.BALL_GROUP, layout.ball_rows(ball))

    def write_frames(self, camera: str, t_us: NDArray, exposure_us: NDArray, images: NDArray[np.uint8]) -> None:
        """Add pictures (N, height, width) or (N, height, width, 3 = RGB) of one camera, `t_us` at mid exposure.

        Args:
            camera: its name.
            t_us: (N,) middle of each exposure.
            exposure_us: (N,) lengths.
            images: (N, height, width) or (N, height, width, 3), RGB.

        Raises:
            RecordingError: if they are of another size than those before, or time runs backwards.
        """
        self._buffer(camera)
        shape, got = self._picture_shapes.setdefault(camera, images.shape[1:]), images.shape[1:]
        if got != shape:
            where = f"{self.path}, camera {camera}"
            raise RecordingError("pictures of another size", expected=shape, got=got, where=where)
        rows = {"t_us": t_us.astype(np.int64), "exposure_us": exposure_us.astype(np.int64), "image": images}
        self.append_rows(layout.frames_group(camera), rows)

    def write_frame(self, camera: str, frame: CameraFrame, zero_us: int) -> None:
        """Add a picture as `write_frames` does, with times on a clock that begins at `zero_us` of the picture's."""
        t_us, exposure_us = np.array([frame.t_us - zero_us]), np.array([frame.exposure_us])
        self.write_frames(camera, t_us, exposure_us, frame.image[None])

    def note(self, text: str) -> None:
        """Say something that a reader of the recording should know."""
        self._append_frame({"kind": "note", "text": encodable(text)})

    def extend_duration(self, duration_us: int) -> None:
        """Make the recording at least this long, though nothing may happen at its end."""
        self._duration_us = max(self._duration_us, int(duration_us))
        self._append_frame({"kind": "duration", "duration_us": self._duration_us})

    @property
    def duration_us(self) -> int:
        """Length of the recording so far."""
        return self._duration_us

    def event_count(self, camera: str) -> int:
        """Events of one camera so far."""
        buffer = self._buffer(camera)
        return buffer.start + buffer.filled

    def flush(self, *, sync: bool = False) -> None:
        """Make everything appended so far survive a kill; with `sync` a power cut too."""
        for camera, buffer in self._cameras.items():
            if buffer.filled > buffer.flushed:
                self._submit(camera, buffer)
        self._drain(0)
        if self._flushes % _FLUSHES_PER_START == 0:
            self._append_frame(self._start)
        self._flushes += 1
        if sync:
            self._file.sync()

    def close(self) -> None:
        """Finish: the file becomes plain HDF5. If that fails the log stays, and `open_recording` still reads it."""
        if self._file.closed:
            return
        try:
            if not self.failed:
                self.flush()
                indices = {name: buffer.index.marks() for name, buffer in self._cameras.items()}
                if not POSIX:
                    self._file.close()  # there nobody reads what is locked
                assemble(self.path, indices=indices)
        except RecordingError:
            self.failed = True
            raise
        finally:
            self._packers.shutdown(wait=True, cancel_futures=True)
            self._file.close()

    def discard(self) -> None:
        """Close and remove the file."""
        self._packers.shutdown(wait=True, cancel_futures=True)
        self._file.close()
        self.path.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _buffer(self, camera: str) -> CameraBuffer:
        try:
            return self._cameras[camera]
        except KeyError:
            names = ", ".join(self._cameras)
            raise RecordingError("no such camera", expected=names, got=camera, where=self.path) from None

    def _submit(self, camera: str, buffer: CameraBuffer) -> None:
        columns, count = buffer.columns, buffer.filled
        meta: dict[str, Json] = {"kind": "events", "camera": camera, "start": buffer.start, "count": count}
        if count == CHUNK_EVENTS:
            buffer.next_block()
        else:  # an unfinished block is written as it is; the same block, longer, will replace it
            columns = tuple(column[:count].copy() for column in columns)
            buffer.flushed = count
        self._pending.append((meta, self._packers.submit(pack_block, columns)))
        self._drain(_PENDING_BLOCKS)

    def _drain(self, keep: int) -> None:
        """Write the oldest packed blocks until at most `keep` are pending; those that are ready go anyway."""
        while self._pending and (len(self._pending) > keep or self._pending[0][1].done()):
            meta, future = self._pending.popleft()
            packed = future.result()
            meta["sizes"] = [len(part) for part in packed]
            self._append_frame(meta, packed)

    def _append_frame(self, meta: Mapping[str, Json], payload: list[bytes] | None = None) -> None:
        if self.failed or self._file.closed:
            raise RecordingError("the recording is closed or could not be written", where=self.path)
        try:
            self._file.append(meta, payload)
        except RecordingError:
            self.failed = True
            raise


def _other_size(stated: SensorSize, sensor: SensorSize) -> str:
    """What may have made the size in a calibration another one."""
    if (stated.width_px, stated.height_px) == (sensor.height_px, sensor.width_px):
        return "width and height seem to be exchanged"
    across, down = stated.width_px / sensor.width_px, stated.height_px / sensor.height_px
    if across == down:
        return f"the pictures were {across:g} times as large: calibrate the sensor's own, or scale K and the size"
    return "calibrate pictures of the sensor's own size: a part of a picture cannot be told from a scaled one"


def _check_names(cameras: Mapping[str, SensorSize], calibration: Mapping[str, Camera]) -> None:
    for name in cameras:
        layout.check_camera_name(name)
    for name, camera in calibration.items():
        if name not in cameras:
            raise RecordingError("calibration of an unknown camera", expected=", ".join(cameras), got=name)
        if camera.sensor != cameras[name]:
            raise RecordingError(
                f"the calibration of camera {name} is for another sensor",
                expected=cameras[name],
                got=camera.sensor,
                remedy=_other_size(camera.sensor, cameras[name]),
            )
