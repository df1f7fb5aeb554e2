"""The events of one camera in a recording file: blocks decoded on demand, several at once, recent ones kept."""

from __future__ import annotations

import threading
from collections import OrderedDict
from concurrent.futures import CancelledError, ThreadPoolExecutor

import h5py
import numpy as np
from numpy.typing import NDArray

from core.errors import EventsError, RecordingError
from core.events import Events, SensorSize
from core.recordings.blocks import CHUNK_EVENTS, unpack_column
from core.recordings.hdf5 import dataset_at, read_only

_KEPT_BLOCKS = 64
"""About 27 MB a camera."""
_BATCH = 16
"""Blocks decoded at a time for a long slice, which would otherwise be in memory twice."""
_COLUMNS = (
    ("t", np.dtype(np.int64)),
    ("x", np.dtype(np.uint16)),
    ("y", np.dtype(np.uint16)),
    ("p", np.dtype(np.uint8)),
)


class EventBlocks:
    """Events by row number; safe to use from several threads."""

    def __init__(self, group: h5py.Group, sensor: SensorSize, threads: ThreadPoolExecutor, *, where: str) -> None:
        self._columns = [_Column(dataset_at(group, name), dtype) for name, dtype in _COLUMNS]
        lengths = {len(column.dataset) for column in self._columns}
        if len(lengths) != 1:
            raise RecordingError("event columns differ in length", got=lengths, where=where)
        self.event_count = lengths.pop()
        self._sensor = sensor
        self._threads = threads
        self._where = where
        self._kept: OrderedDict[int, Events] = OrderedDict()
        self._lock = threading.Lock()

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
            t_us, x_px, y_px, on = (column.read(start, count) for column in self._columns)
            return Events.from_columns(t_us, x_px, y_px, on.view(np.bool_), self._sensor)
        except (OSError, ValueError, RuntimeError, EventsError) as error:
            raise RecordingError(
                f"the recording is closed or damaged at event {start:,}", got=error, where=self._where
            ) from error


class _Column:
    """One dataset; chunks as our writer makes them are unpacked here, anything else is left to HDF5."""

    def __init__(self, dataset: h5py.Dataset, dtype: np.dtype) -> None:
        self.dataset = dataset
        self._dtype = dtype
        self._shuffled = bool(dataset.shuffle)
        self._is_ours = (
            dataset.dtype == dtype
            and dataset.chunks == (CHUNK_EVENTS,)
            and dataset.compression == "gzip"
            and not dataset.fletcher32
            and dataset.scaleoffset is None
        )

    def read(self, start: int, count: int) -> NDArray:
        if self._is_ours:
            skipped_filters, packed = self.dataset.id.read_direct_chunk((start,))
            if skipped_filters == 0:
                return unpack_column(packed, self._dtype, (CHUNK_EVENTS,), shuffled=self._shuffled)[:count]
        return read_only(self.dataset[start : start + count].astype(self._dtype))
