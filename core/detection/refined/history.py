"""Events of the last milliseconds in contiguous arrays, for fits of any history length."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.events import Events

ROOM: Final = 1 << 17


class Recent(NamedTuple):
    """Columns of the stored events, oldest first, for compiled code."""

    t_us: NDArray[np.int64]
    x_px: NDArray[np.uint16]
    y_px: NDArray[np.uint16]
    on: NDArray[np.bool_]


class EventHistory:
    """Stores `span_us` of events. A window is copied once; old events are dropped when the arrays are full."""

    def __init__(self, span_us: int) -> None:
        self.span_us = span_us
        self._columns = _room_for(ROOM)
        self._first = self._end = 0

    def append(self, events: Events, end_us: int) -> None:
        """Append a window that ends at `end_us`."""
        count = len(events)
        self._first += int(np.searchsorted(self._columns.t_us[self._first : self._end], end_us - self.span_us))
        if self._end + count > len(self._columns.t_us):
            self._move(count)
        where = slice(self._end, self._end + count)
        for column, new in zip(self._columns, (events.t_us, events.x_px, events.y_px, events.on), strict=True):
            column[where] = new
        self._end += count

    @property
    def recent(self) -> Recent:
        """The stored events."""
        where, kept = slice(self._first, self._end), self._columns
        return Recent(kept.t_us[where], kept.x_px[where], kept.y_px[where], kept.on[where])

    def _move(self, count: int) -> None:
        """Free capacity: drop old events, or allocate larger columns."""
        kept, old = self.recent, self._columns
        wanted = len(kept.t_us) + count
        if 2 * wanted > len(old.t_us):
            self._columns = _room_for(4 * wanted)
        for column, was in zip(self._columns, kept, strict=True):
            column[: len(was)] = was
        self._first, self._end = 0, len(kept.t_us)


def _room_for(count: int) -> Recent:
    return Recent(
        np.empty(count, np.int64), np.empty(count, np.uint16), np.empty(count, np.uint16), np.empty(count, np.bool_)
    )
