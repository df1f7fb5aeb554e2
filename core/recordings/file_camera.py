"""One camera of our recording file: its events in blocks that are decoded on demand, and what is known of it."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.errors import EventsError, RecordingError
from core.events import Events, SensorSize
from core.recordings import layout
from core.recordings.blocks import CHUNK_EVENTS, unpack_column
from core.recordings.hdf5 import (
    HDF5_ERRORS,
    DamageNotes,
    check_stored,
    dataset_at,
    group_at,
    hdf5_errors,
    names_in,
    read_only,
    read_whole,
    whole_number,
)
from core.recordings.ms_index import MAX_TIME_US, index_agrees, index_of
from core.recordings.recording import Triggers
from core.recordings.truth import PixelTruth, credible_pixels

_KEPT_BLOCKS = 64
"""About 27 MB a camera."""
_BATCH = 16
"""Blocks decoded at a time for a long slice, which would otherwise be in memory twice."""
_LARGEST_CHUNK = 1 << 30
_COLUMNS = (
    ("t", np.dtype(np.int64), "iu"),
    ("x", np.dtype(np.uint16), "iu"),
    ("y", np.dtype(np.uint16), "iu"),
    ("p", np.dtype(np.uint8), "biu"),
)


class EventBlocks:
    """Events by row number; safe to use from several threads."""

    def __init__(self, group: h5py.Group, sensor: SensorSize, threads: ThreadPoolExecutor, *, where: str) -> None:
        self._columns = [_Column(dataset_at(group, name), name, dtype, kinds, where) for name, dtype, kinds in _COLUMNS]
        lengths = {len(column.dataset) for column in self._columns}
        if len(lengths) != 1:
            raise RecordingError("event columns differ in length", got=lengths, where=where)
        self.event_count = lengths.pop()
        self._sensor = sensor
        self._threads = threads
        self._where = where
        self._marks: NDArray[np.int64] | None = None
        self._kept: OrderedDict[int, Events] = OrderedDict()
        self._lock = threading.Lock()

    def check_index(self, marks: NDArray[np.int64]) -> None:
        """From now on the times of every block are compared with this index, with the number of events at its end."""
        self._marks = marks

    def compute_index(self) -> NDArray[np.int64]:
        """The index, from the times of all events.

        Raises:
            RecordingError: if they cannot all be read, or run backwards.
        """
        check_stored(self._columns[0].dataset)
        return index_of(self._all_times(), self._where)

    def _all_times(self) -> Iterator[NDArray[np.int64]]:
        for start in range(0, self.event_count, CHUNK_EVENTS):
            yield self._times(start)

    def last_us(self) -> int | None:
        """The time of the last event; None without events, or if its block is damaged."""
        if not self.event_count:
            return None
        try:
            last_us = int(self._times((self.event_count - 1) // CHUNK_EVENTS * CHUNK_EVENTS)[-1])
        except RecordingError:
            return None
        return last_us if 0 <= last_us < MAX_TIME_US else None

    def _times(self, start: int) -> NDArray[np.int64]:
        with hdf5_errors(f"the recording is closed or damaged at event {start:,}", self._where):
            t_us = self._columns[0].read(start, min(CHUNK_EVENTS, self.event_count - start))
            if t_us.dtype.kind == "u" and len(t_us) and int(t_us.max()) >= MAX_TIME_US:
                raise ValueError(f"a time of {t_us.max()} us")
            return t_us.astype(np.int64, copy=False)

    def rows(self, first: int, last: int) -> Events:
        """Events number first to last - 1; `first` must be below `last`."""
        numbers = range(first // CHUNK_EVENTS, (last - 1) // CHUNK_EVENTS + 1)
        if len(numbers) == 1:
            start = numbers[0] * CHUNK_EVENTS
            return self._load(numbers)[0].rows(slice(first - start, last - start))
        columns = tuple(np.empty(last - first, dtype) for dtype in (np.int64, np.uint16, np.uint16, np.bool_))
        for batch in (numbers[i : i + _BATCH] for i in range(0, len(numbers), _BATCH)):
            for number, block in zip(batch, self._load(batch), strict=True):
                start = number * CHUNK_EVENTS
                source = slice(max(0, first - start), min(len(block), last - start))
                target = slice(source.start + start - first, source.stop + start - first)
                for column, values in zip(columns, (block.t_us, block.x_px, block.y_px, block.on), strict=True):
                    column[target] = values[source]
                if target.start and columns[0][target.start] < columns[0][target.start - 1]:
                    raise RecordingError(f"time runs backwards at event {start:,}", where=self._where)
        t_us, x_px, y_px, on = (read_only(column) for column in columns)
        return Events(t_us, x_px, y_px, on, self._sensor)  # each block was checked when it was decoded

    def _load(self, numbers: range) -> list[Events]:
        with self._lock:
            found = {number: self._kept[number] for number in numbers if number in self._kept}
            for number in found:
                self._kept.move_to_end(number)
        missing = [number for number in numbers if number not in found]
        if len(missing) > 2:
            try:
                decoded = list(self._threads.map(self._decode, missing))
            except (RuntimeError, CancelledError) as error:  # the threads are gone
                raise RecordingError("the recording is closed", where=self._where) from error
        else:
            decoded = [self._decode(number) for number in missing]
        found.update(zip(missing, decoded, strict=True))
        with self._lock:
            for number, block in zip(missing, decoded, strict=True):
                self._kept[number] = block
            while len(self._kept) > _KEPT_BLOCKS:
                self._kept.popitem(last=False)
        return [found[number] for number in numbers]

    def _decode(self, number: int) -> Events:
        start = number * CHUNK_EVENTS
        count = min(CHUNK_EVENTS, self.event_count - start)
        try:
            t_us = self._times(start)
            x_px, y_px, polarity = (column.read(start, count) for column in self._columns[1:])
            events = Events.from_columns(t_us, x_px, y_px, polarity > 0, self._sensor)
        except (*HDF5_ERRORS, EventsError) as error:
            raise RecordingError(
                f"the recording is closed or damaged at event {start:,}", got=error, where=self._where
            ) from error
        if self._marks is not None and not index_agrees(self._marks, events.t_us, start):
            raise RecordingError(
                f"the index ms_to_idx does not fit the times at event {start:,}",
                where=self._where,
                remedy="remove ms_to_idx from the file: it is computed again",
            )
        return events


class _Column:
    """One dataset; chunks as our writer makes them are unpacked here, anything else is left to HDF5."""

    def __init__(self, dataset: h5py.Dataset, name: str, dtype: np.dtype, kinds: str, where: str) -> None:
        if dataset.ndim != 1 or dataset.dtype.kind not in kinds:
            got = f"{dataset.dtype}{dataset.shape}"
            raise RecordingError(f"event column {name} holds something else", expected=dtype, got=got, where=where)
        if dataset.chunks is not None and dataset.chunks[0] * dataset.dtype.itemsize > _LARGEST_CHUNK:
            raise RecordingError(f"event column {name} has absurd chunks", got=dataset.chunks, where=where)
        self.dataset = dataset
        self._dtype = dtype
        with hdf5_errors(f"event column {name} cannot be read", where):
            self._shuffled = bool(dataset.shuffle)
            self._is_ours = (
                dataset.dtype == dtype
                and dataset.chunks == (CHUNK_EVENTS,)
                and dataset.compression == "gzip"
                and not dataset.fletcher32
                and dataset.scaleoffset is None
            )

    def read(self, start: int, count: int) -> NDArray:
        """Values as stored; the caller checks the range."""
        if self._is_ours:
            skipped_filters, packed = self.dataset.id.read_direct_chunk((start,))
            if skipped_filters == 0:
                return unpack_column(packed, self._dtype, (CHUNK_EVENTS,), shuffled=self._shuffled)[:count]
        return read_only(self.dataset[start : start + count])


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
