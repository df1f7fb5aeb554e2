"""The block of one camera that is being filled by the writer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.events import Events, SensorSize
from core.recordings.blocks import CHUNK_EVENTS, pack_column
from core.recordings.ms_index import MsIndex


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
