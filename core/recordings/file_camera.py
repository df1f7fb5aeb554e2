"""One camera of our recording file: its events in time, and what is known of it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings import layout
from core.recordings.event_blocks import EventBlocks
from core.recordings.hdf5 import DamageNotes, dataset_at, group_at, names_in, read_whole, whole_number
from core.recordings.ms_index import MAX_TIME_US
from core.recordings.recording import Triggers
from core.recordings.truth import PixelTruth, credible_pixels

_NO_TRIGGERS = layout.triggers_from_rows({"t": np.empty(0), "p": np.empty(0), "id": np.empty(0)})


class RowsOfFile(Protocol):
    """The recording that a camera belongs to."""

    path: Path
    duration_us: int

    def read_rows(self, group: str) -> layout.Rows | None: ...

    def check_open(self) -> None: ...


class FileCamera:
    """One camera of a recording file."""

    def __init__(
        self, recording: RowsOfFile, group: h5py.Group, threads: ThreadPoolExecutor, notes: DamageNotes
    ) -> None:
        self._recording = recording
        self._notes = notes
        self._name = str(group.name).rsplit("/", 1)[-1]
        self._sensor = SensorSize(*(whole_number(group, side, 1, 65536) for side in ("width", "height")))
        where = f"{recording.path}, camera {self._name}"
        self._blocks = EventBlocks(group_at(group, "events"), self._sensor, threads, where=where)
        last_us = self._blocks.last_us()
        self._marks = self._read_index(group, last_us)
        self.end_us = (len(self._marks) - 2) * 1000 + 1 if last_us is None else last_us + 1
        """The recording is at least so long."""
        self._blocks.check_index(self._marks)
        self.t_offset_us = 0
        with notes.left_out(f"the time offset of camera {self._name}"):
            self.t_offset_us = _whole_scalar(dataset_at(group, "t_offset"))
        self._calibration: Camera | None = None
        if "calibration" in names_in(group):
            with notes.left_out(f"the calibration of camera {self._name}"):
                self._calibration = layout.read_calibration(group_at(group, "calibration"), self._sensor)

    def _read_index(self, group: h5py.Group, last_us: int | None) -> NDArray[np.int64]:
        """The first event of each millisecond, and the number of all; of a file that lacks it, from the times."""
        count = self._blocks.event_count
        try:
            marks = read_whole(dataset_at(group, "ms_to_idx"))
            if marks.ndim != 1 or marks.dtype.kind not in "iu" or len(marks) > MAX_TIME_US // 1000:
                raise RecordingError("it holds something else", got=f"{marks.dtype}{marks.shape}")
            if len(marks) and not (marks[0] == 0 and int(marks[-1]) <= count and (marks[1:] >= marks[:-1]).all()):
                raise RecordingError("it does not ascend from 0")
            if (last_us is not None and len(marks) != last_us // 1000 + 1) or bool(count) != bool(len(marks)):
                raise RecordingError("its length does not fit the events", got=len(marks))
        except RecordingError as error:
            self._notes.add(f"The index ms_to_idx of camera {self._name} was computed again: {error}.")
            return np.append(self._blocks.compute_index(), count)
        return np.append(marks.astype(np.int64), count)

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
        if rows is None:
            return None
        stated = layout.pixel_truth_from_rows(rows)
        truth = credible_pixels(stated)
        if truth is not stated:
            self._notes.add(f"The truth of camera {self._name} is absurd now and then: not visible there.")
        return truth

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


def _whole_scalar(dataset: h5py.Dataset) -> int:
    value = read_whole(dataset)
    if value.size != 1 or value.dtype.kind not in "iu" or not abs(int(value.reshape(-1)[0])) < 2**62:
        raise RecordingError(f"{dataset.name} is no whole number", got=f"{value.dtype}{value.shape}")
    return int(value.reshape(-1)[0])
