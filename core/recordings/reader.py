"""Our recording file, read: time slices of its cameras from any number of threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Self

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RallyscopeError, RecordingError
from core.events import Events, SensorSize
from core.recordings import layout
from core.recordings.event_blocks import EventBlocks
from core.recordings.frames import FrameStream
from core.recordings.hdf5 import attribute, dataset_at, group_at
from core.recordings.recording import CameraStream, Triggers
from core.recordings.truth import BallTruth, PixelTruth
from core.text.json_text import parse_json

_NO_TRIGGERS = layout.triggers_from_rows({"t": np.empty(0), "p": np.empty(0), "id": np.empty(0)})


class FileRecording:
    """A recording of ours on disk."""

    def __init__(self, path: Path, *, on_close: Callable[[], None] | None = None) -> None:
        """Open the file; nothing is read before it is asked for.

        Raises:
            RecordingError: if it is damaged or of a newer version.
        """
        self.path = path
        self._on_close = on_close
        self._threads = ThreadPoolExecutor(2, thread_name_prefix="unpack")
        try:
            self._file = h5py.File(path, "r")
        except OSError as error:
            raise RecordingError("the HDF5 file cannot be opened", got=error, where=path) from error
        try:
            self._read_header()
        except RallyscopeError:
            self._file.close()
            raise
        except (KeyError, ValueError, TypeError, AttributeError, OSError, RuntimeError) as error:
            self._file.close()
            raise RecordingError("the recording is damaged", got=error, where=path) from error

    def _read_header(self) -> None:
        file = self._file
        version = int(attribute(file, "version"))
        if version > layout.VERSION:
            raise RecordingError(
                "the recording is of a newer version",
                expected=f"version {layout.VERSION} or below",
                got=version,
                where=self.path,
                remedy="update Rallyscope",
            )
        self.uuid = str(attribute(file, "uuid"))
        self.seed = int(attribute(file, "seed")) if "seed" in file.attrs else None
        self.config = parse_json(attribute(file, "config")) if "config" in file.attrs else None
        self.duration_us = int(attribute(file, "duration_us"))
        self.notes = tuple(map(str, attribute(file, "notes"))) if "notes" in file.attrs else ()
        group = group_at(file, "cameras")
        names = map(str, attribute(group, "order")) if "order" in group.attrs else sorted(group)
        self._cameras: dict[str, CameraStream] = {
            name: FileCamera(self, group_at(group, name), self._threads) for name in names if _has_events(group, name)
        }

    @property
    def cameras(self) -> dict[str, CameraStream]:
        return dict(self._cameras)

    @property
    def groups(self) -> tuple[str, ...]:
        """Every group of columns outside /cameras, such as "/racket" or "/ground_truth/ball"."""
        found: list[str] = []

        def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
            if not isinstance(item, h5py.Group) or name.startswith("cameras"):
                return
            if any(isinstance(child, h5py.Dataset) for child in item.values()):
                found.append(f"/{name}")

        self._file.visititems(visit)
        return tuple(found)

    def read_rows(self, group: str) -> layout.Rows | None:
        """All columns of a group, or None if the recording does not have it."""
        self.check_open()
        item = self._file.get(group)
        return layout.read_rows(item) if isinstance(item, h5py.Group) else None

    @property
    def ball(self) -> BallTruth | None:
        return self._ball

    @cached_property
    def _ball(self) -> BallTruth | None:
        rows = self.read_rows(layout.BALL_GROUP)
        return None if rows is None else layout.ball_from_rows(rows)

    @cached_property
    def frames(self) -> dict[str, FrameStream]:
        """Pictures of ordinary cameras, by camera."""
        self.check_open()
        group = group_at(self._file, "cameras")
        return {
            name: FrameStream(group_at(group, f"{name}/frames"))
            for name in map(str, group)
            if f"{name}/frames" in group
        }

    def check_open(self) -> None:
        if not self._file.id.valid:
            raise RecordingError("the recording is closed", where=self.path)

    def close(self) -> None:
        if self._file.id.valid:
            self._threads.shutdown(wait=True, cancel_futures=True)
            self._file.close()
            if self._on_close is not None:
                self._on_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _has_events(cameras: h5py.Group, name: str) -> bool:
    """Not so for an ordinary camera, which is in the file for its frames."""
    return f"{name}/frames" not in cameras or len(dataset_at(cameras, f"{name}/events/t")) > 0


class FileCamera:
    """One camera of a recording file."""

    def __init__(self, recording: FileRecording, group: h5py.Group, threads: ThreadPoolExecutor) -> None:
        self._recording = recording
        self._name = str(group.name).rsplit("/", 1)[-1]
        self._sensor = SensorSize(int(attribute(group, "width")), int(attribute(group, "height")))
        where = f"{recording.path}, camera {self._name}"
        self._blocks = EventBlocks(group_at(group, "events"), self._sensor, threads, where=where)
        marks = dataset_at(group, "ms_to_idx")[()].astype(np.int64)
        self._marks = np.append(marks, self._blocks.event_count)
        if bool((np.diff(self._marks) < 0).any()) or (len(marks) and marks[0] != 0):
            raise RecordingError("the index ms_to_idx is damaged", where=where)
        self.t_offset_us = int(dataset_at(group, "t_offset")[()])
        self._calibration = (
            layout.read_calibration(group_at(group, "calibration"), self._sensor) if "calibration" in group else None
        )

    @property
    def name(self) -> str:
        return self._name

    @property
    def sensor(self) -> SensorSize:
        return self._sensor

    @property
    def event_count(self) -> int:
        return self._blocks.event_count

    @property
    def calibration(self) -> Camera | None:
        return self._calibration

    @property
    def triggers(self) -> Triggers:
        return self._triggers

    @cached_property
    def _triggers(self) -> Triggers:
        rows = self._recording.read_rows(layout.triggers_group(self._name))
        return _NO_TRIGGERS if rows is None else layout.triggers_from_rows(rows)

    @property
    def truth(self) -> PixelTruth | None:
        return self._truth

    @cached_property
    def _truth(self) -> PixelTruth | None:
        rows = self._recording.read_rows(layout.truth_group(self._name))
        return None if rows is None else layout.pixel_truth_from_rows(rows)

    def slice(self, start_us: int, end_us: int) -> Events:
        """The events with `start_us <= t < end_us`.

        Raises:
            RecordingError: if the recording is closed or damaged there.
        """
        self._recording.check_open()
        first = self._mark(int(start_us) // 1000)
        last = self._mark(-(-int(end_us) // 1000))
        if first >= last:
            return Events.empty(self._sensor)
        return self._blocks.rows(first, last).between(start_us, end_us)

    def counts_per_ms(self) -> NDArray[np.int64]:
        counts = np.zeros(-(-self._recording.duration_us // 1000), np.int64)
        own = np.diff(self._marks)
        counts[: len(own)] = own
        counts.flags.writeable = False
        return counts

    def _mark(self, ms: int) -> int:
        """The first event at or after a millisecond."""
        return int(self._marks[min(max(ms, 0), len(self._marks) - 1)])
