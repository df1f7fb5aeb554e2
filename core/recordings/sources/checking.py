"""Makes events out of what a decoder found: what cannot be true is left out and counted, the rest is kept."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.foreign_tables import allowed_odd
from core.recordings.layout import MAX_TIME_US
from core.recordings.sources.source import Columns, DecodeReport
from core.recordings.sources.values import outliers
from core.recordings.sources.values.assumed_sizes import LARGEST_PX

_JITTER_US: Final = 1000
"""Steps back up to this are the disorder of a read-out or a network; the event gets the time of the one before it."""
STREAM_PAUSE_US: Final = 600_000_000
"""Ten minutes without one event: in a binary stream rather a damaged time stamp."""
DISORDER_US: Final = 1_000_000
"""The rows of a table are sorted if none comes later than this."""
_MIN_ROWS: Final = 1 << 14
"""Parts are judged together up to this number, so that there are neighbours to look at."""
NO_WRAPS: Final[tuple[int, ...]] = ()
_DOUBLE_SHARE: Final = 0.4
"""Share of events that are there a second time from which on a table seems to hold its rows twice."""
_LEAST_LOOK: Final = 100
_DOUBLE_LOOK: Final = 1 << 17
"""Events, from the first one, that are looked at for that."""
OUTSIDE: Final = "outside the sensor"
WRONG_TIME: Final = "wrong time"
CUT_SHORT: Final = "bytes at the end"
RESERVED_WORDS: Final = "reserved words"
DAMAGED_TIMES: Final = "damaged time words"
PADDING: Final = "padding"
"""Reasons for which something is left out."""


def check_stream(
    parts: Iterable[Columns],
    sensor: SensorSize,
    report: DecodeReport,
    *,
    where: str,
    clock_lengths_us: tuple[int, ...] = NO_WRAPS,
) -> Iterator[Events]:
    """Events of a binary stream without those that cannot be true; the report counts what was left out.

    A clock that begins again after one of `clock_lengths_us` runs on.

    Raises:
        RecordingError: if more than 1 % of the events lie outside the sensor.
    """
    check = _Check(sensor, report, where, _JITTER_US, STREAM_PAUSE_US, clock_lengths_us, table=False)
    yield from check.events(parts)


def check_table(
    parts: Iterable[Columns],
    sensor: SensorSize,
    report: DecodeReport,
    *,
    where: str,
    clock_lengths_us: tuple[int, ...] = NO_WRAPS,
) -> Iterator[Events]:
    """Events of a table, sorted where rows come up to a second late; the report counts what was left out.

    Raises:
        RecordingError: if time runs further back, or more than 1 % of the rows have a wrong time or address.
    """
    check = _Check(sensor, report, where, DISORDER_US, MAX_TIME_US, clock_lengths_us, table=True)
    looked, doubles = 0, 0
    for part in _sorted_parts(check.events(parts), sensor):
        if looked < _DOUBLE_LOOK:  # rows that are there twice are so everywhere
            some = slice(0, _DOUBLE_LOOK - looked)
            doubles += _count_doubles(part.t_us[some], part.x_px[some], part.y_px[some], part.on[some])
            looked += min(len(part), _DOUBLE_LOOK - looked)
        yield part
    if looked > _LEAST_LOOK and doubles > _DOUBLE_SHARE * looked:
        text = f"{doubles:,} of the first {looked:,} events are there a second time, with equal t, x, y and polarity"
        report.notes.append(f"{where}: {text}; was the file written twice? All are kept.")


def _count_doubles(t_us: NDArray, x_px: NDArray, y_px: NDArray, on: NDArray) -> int:
    """How many of the events (N,) are equal to another one before them."""
    order = np.lexsort((on, x_px, y_px, t_us))
    columns = [column[order] for column in (t_us, x_px, y_px, on)]
    equal = np.ones(max(0, len(order) - 1), np.bool_)
    for column in columns:
        equal &= column[1:] == column[:-1]
    return int(np.count_nonzero(equal))


def without_padding(rows: NDArray) -> tuple[NDArray, int]:
    """The rows of a binary file, (N, K) or (N,) records, but for padding, and how many rows are that.

    Padding is rows filled with zeros or ones beside another such row: no pixel has two events at one time.
    """
    columns = [rows[name] for name in rows.dtype.names] if rows.dtype.names else list(rows.T)
    zeros, ones = np.ones((2, len(rows)), np.bool_)
    for column in columns:
        zeros &= column == 0
        ones &= column == np.iinfo(column.dtype).max
    filled = zeros | ones
    if not filled.any():
        return rows, 0
    beside = np.zeros_like(filled)
    beside[1:] |= filled[:-1]
    beside[:-1] |= filled[1:]
    empty = filled & beside
    return rows[~empty], int(np.count_nonzero(empty))


def note_padding(count: int, where: str, report: DecodeReport) -> None:
    """Count rows that are no events but padding."""
    report.leave_out(PADDING, count, f"{where}: {count:,} rows of zeros or ones (padding) were left out.")


def refuse_zeros(count: int, path: Path) -> None:
    """Raise RecordingError for a RAW file whose `count` bytes behind the header, if there are any, are all 0."""
    if count:
        what, remedy = "no events could be read: all bytes behind the header are 0", "was the file copied to its end?"
        raise RecordingError(what, got=f"{count:,} bytes", where=path, remedy=remedy)


def refuse_many_outside(outside: int, total: int, sensor: SensorSize, largest: tuple[int, int], where: str) -> None:
    """Raise if so many addresses lie outside the sensor that its size must be wrong; `largest` column and row found.

    Raises:
        RecordingError: naming the size that would hold them all.
    """
    if outside <= allowed_odd(total):
        return
    expected, remedy = _likeliest_size(sensor, largest)
    raise RecordingError(
        f"{outside:,} of {total:,} events lie outside the {sensor} sensor",
        expected=expected,
        where=where,
        remedy=remedy,
    )


def _likeliest_size(sensor: SensorSize, largest: tuple[int, int]) -> tuple[str, str]:
    """What would hold events that lie outside the sensor, and what to do."""
    column, row = largest
    turned = SensorSize(sensor.height_px, sensor.width_px)
    if column < sensor.width_px and row < sensor.height_px:
        return "no addresses below 0", "check which camera and which columns these are"
    if max(column, row) >= LARGEST_PX:
        expected = f"addresses of a sensor; they go up to {column}, {row}"
        return expected, "bytes may be missing, or the file is of another format than it says"
    if column < turned.width_px and row < turned.height_px:
        return f"{turned}, which would hold them: width and height are exchanged", "give --width and --height"
    width, height = max(column + 1, sensor.width_px), max(row + 1, sensor.height_px)
    expected = f"a sensor of at least {width}x{height}, which would hold them"
    return expected, "check the sensor size (--width, --height)"


def outside_note(outside: int, sensor: SensorSize, largest: tuple[int, int], where: str) -> str:
    """What is said of events that were left out because of their address."""
    return (
        f"{where}: {outside:,} events outside the {sensor} sensor were left out"
        f" (addresses up to {largest[0]}, {largest[1]})."
    )


@dataclass(slots=True)
class _Check:
    """One pass over the parts of a source."""

    sensor: SensorSize
    report: DecodeReport
    where: str
    jitter_us: int
    longest_us: int
    lengths: tuple[int, ...]
    table: bool
    state: NDArray[np.int64] = field(default_factory=outliers.start_state)
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))
    first_us: int | None = None

    def events(self, parts: Iterable[Columns]) -> Iterator[Events]:
        """The good events of each part; the last few rows wait for the part after it, which says what they are."""
        waiting: Columns | None = None
        for part in _large_enough(parts):
            rows = _cast(part)
            if waiting is not None:
                rows = Columns(*(np.concatenate(pair) for pair in zip(waiting, rows, strict=True)))
            ready = max(0, len(rows.t_us) - outliers.FAR_AHEAD)
            yield from self._judge(rows, ready)
            if self.state[outliers.END]:
                return
            waiting = Columns(*(column[ready:] for column in rows))
        if waiting is not None:
            yield from self._judge(waiting, len(waiting.t_us))
        if not self.state[outliers.END]:
            self._finish()

    def _judge(self, rows: Columns, ready: int) -> Iterator[Events]:
        kind = np.full(len(rows.t_us), outliers.STRAY, np.uint8)
        size = self.sensor.width_px, self.sensor.height_px
        lengths = np.array(self.lengths, np.int64)
        bounds = outliers.AddressBounds(*size, self.jitter_us, self.longest_us, lengths, not self.table)
        used = outliers.mark_outliers(outliers.Rows(*rows[:3], kind), ready, bounds, self.state)
        kind = kind[:used]
        self.counts += np.bincount(kind, minlength=4)
        keep = kind == outliers.GOOD
        columns = (column[:used] if keep.all() else column[:used][keep] for column in rows)
        t_us, x_px, y_px, on = columns
        if len(t_us):
            self.first_us = int(t_us[0]) if self.first_us is None else self.first_us
            too_late = t_us - self.first_us >= MAX_TIME_US
            if too_late.any():
                self.state[outliers.END] = outliers.AHEAD
                t_us, x_px, y_px, on = (column[~too_late] for column in (t_us, x_px, y_px, on))
            if self.table:
                yield _unsorted(t_us, x_px, y_px, on, self.sensor)
            else:
                yield Events.from_columns(t_us, x_px, y_px, on, self.sensor)
        if self.state[outliers.END]:
            self._stop(rows, used)

    def _stop(self, rows: Columns, at: int) -> None:
        now = int(self.state[outliers.NOW])
        step = int(rows.t_us[min(at, len(rows.t_us) - 1)]) + int(self.state[outliers.EPOCH]) - now
        count = int(self.counts.sum())
        if self.state[outliers.END] == outliers.BACK:
            reason = f"time runs {-step:,} us back, and goes on from there"
        else:
            reason = f"time jumps {max(step, 0):,} us ahead, beyond {self.longest_us / 1e6:,.0f} s"
        if self.table:
            remedy = "sort the events by time, or split the file" if "back" in reason else "check --time-unit"
            raise RecordingError(f"event {count:,} cannot be used: {reason}", where=self.where, remedy=remedy)
        self.report.notes.append(f"{self.where}: stopped at event {count:,}: {reason}.")
        self._finish()

    def _finish(self) -> None:
        """Say what was left out, or refuse what cannot be true as a whole."""
        good, stray, outside, damaged = self.counts.tolist()
        largest = int(self.state[outliers.MAX_X]), int(self.state[outliers.MAX_Y])
        where = self.where
        total = good + stray + outside + damaged
        refuse_many_outside(outside, total, self.sensor, largest, where)
        if self.table and stray + damaged > allowed_odd(total):
            what = f"the times of {stray + damaged:,} of {total:,} events lie apart from those of their neighbours"
            raise RecordingError(what, where=where, remedy="check which column is the time, and sort the events by it")
        report = self.report
        report.leave_out(OUTSIDE, outside, outside_note(outside, self.sensor, largest, where))
        apart = f"{where}: {stray + damaged:,} events were left out: their times lie apart from the others."
        report.leave_out(WRONG_TIME, stray + damaged, apart)
        late, latest_us = int(self.state[outliers.LATE]), int(self.state[outliers.LATEST])
        if self.table:
            note = f"{where}: {late:,} events were out of order by up to {latest_us / 1e3:g} ms; now sorted."
            report.change("sorted by time", late, note)
        else:
            note = f"{where}: {late:,} events came up to 1 ms too early; they have the time before them."
            report.change("time stepped back", late, note)
        wraps = int(self.state[outliers.WRAPS])
        note = f"{where}: the clock began again at 0 {wraps} times; its time runs on."
        report.change("clock began again", wraps, note)


def _large_enough(parts: Iterable[Columns]) -> Iterator[Columns]:
    """The parts, small ones put together."""
    small: list[Columns] = []
    rows = 0
    for part in parts:
        if not len(part.t_us):
            continue
        small.append(part)
        rows += len(part.t_us)
        if rows >= _MIN_ROWS:
            yield _together(small)
            small, rows = [], 0
    if small:
        yield _together(small)


def _together(parts: list[Columns]) -> Columns:
    return parts[0] if len(parts) == 1 else Columns(*(np.concatenate(some) for some in zip(*parts, strict=True)))


def _cast(part: Columns) -> Columns:
    t, x, y = (np.array(column, np.int64) for column in part[:3])
    return Columns(t, x, y, np.ascontiguousarray(part.on, np.bool_))


def _unsorted(t: NDArray, x: NDArray, y: NDArray, on: NDArray, sensor: SensorSize) -> Events:
    """Columns on their way to be sorted, in the dress of events."""
    if (t[1:] >= t[:-1]).all():
        return Events.from_columns(t, x, y, on, sensor)
    order = np.argsort(t, kind="stable")
    return Events.from_columns(t[order], x[order], y[order], on[order], sensor)


def _sorted_parts(parts: Iterable[Events], sensor: SensorSize) -> Iterator[Events]:
    """Events in the order of their times; each part is sorted in itself and may overlap those before it."""
    held: deque[Events] = deque()
    latest_us = 0
    for part in parts:
        if not len(part):
            continue
        overlapping = [part]
        while held and held[-1].t_us[-1] > part.t_us[0]:
            overlapping.append(held.pop())
        if len(overlapping) > 1:
            overlapping.reverse()
            part = _merged(overlapping, sensor)
        latest_us = max(latest_us, int(part.t_us[-1])) if held else int(part.t_us[-1])
        held.append(part)
        while len(held) > 1 and held[0].t_us[-1] <= latest_us - DISORDER_US:
            yield held.popleft()
    yield from held


def _merged(parts: list[Events], sensor: SensorSize) -> Events:
    t = np.concatenate([part.t_us for part in parts])
    order = np.argsort(t, kind="stable")
    x, y, on = (np.concatenate([getattr(part, name) for part in parts])[order] for name in ("x_px", "y_px", "on"))
    return Events.from_columns(t[order], x, y, on, sensor)
