"""Event Stream files (.es) of DVS and ATIS cameras; one odd event costs itself, lost bytes cost little more.

Source: the format's description (github.com/neuromorphicsystems/event_stream, version 2). After a header of 20 bytes
an event is a byte of time, then column and row of 16 bits, the row from the bottom.
    DVS   time: 7 bits of us since the event before, then ON; 0xFF: 127 us have passed; 0xFE: nothing
    ATIS  time: 6 bits of us, then ON, then exposure (such events are left out); 0xFC + n: 63 n us have passed
Nothing marks where an event begins, but addresses outside the sensor betray a decoder that is out of step.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from core.errors import RecordingError
from core.events import SensorSize
from core.foreign_tables import ODD_SHARE, allowed_odd
from core.jit import njit
from core.recordings.sources.checking import (
    CUT_SHORT,
    OUTSIDE,
    check_stream,
    outside_note,
    refuse_many_outside,
)
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource
from core.recordings.sources.values.assumed_sizes import LARGEST_PX

_SIGNATURE: Final = b"Event Stream"
_HEADER: Final = struct.Struct("<12s3BBHH")
_DVS, _ATIS = 1, 2
_TYPES: Final = {0: "generic", 3: "asynchronous", 4: "color"}
_ROOM_EVENTS: Final = 1 << 18
_EVENT_BYTES: Final = 5
_IN_STEP: Final = 8
"""So many events inside the sensor, one after the other, begin where events begin."""
_POSITION, _TIME, _OUTSIDE, _MAX_X, _MAX_Y, _LOST_BYTES, _GAPS = range(7)


def open_es(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of an Event Stream file.

    Raises:
        RecordingError: if it is of another version, or holds other things than events of a DVS or an ATIS.
    """
    with path.open("rb") as file:
        head = file.read(_HEADER.size)
    if len(head) < _HEADER.size:
        raise RecordingError("the file cannot be decoded", got="a header that is cut short", where=path)
    _, major, minor, patch, kind, width, height = _HEADER.unpack(head)
    if major != 2 or kind not in (_DVS, _ATIS, *_TYPES):
        got = f"version {major}.{minor}.{patch}, type {kind}"
        raise RecordingError("the file cannot be decoded", expected="version 2, dvs or atis", got=got, where=path)
    if kind in _TYPES:
        raise RecordingError("an Event Stream of this type", expected="dvs or atis", got=_TYPES[kind], where=path)
    if not width or not height:
        raise RecordingError("the file cannot be decoded", got=f"a sensor of {width}x{height}", where=path)
    stated, atis = SensorSize(width, height), kind == _ATIS
    size = sensor or stated
    # Rows count from the bottom of the size by which they were written: the header's, if its addresses fit.
    bottom = height if size == stated or _fits(path, stated, atis) else size.height_px

    def decode(report: DecodeReport) -> Iterator[Columns]:
        return _decode(path, _Frame(size, bottom, atis), report)

    return [make_source(path, "camera", "Event Stream", size, decode, check_stream)]


class _Frame(NamedTuple):
    """How the bytes of a file are read."""

    size: SensorSize
    bottom: int
    """Rows of the sensor from which the file counts."""
    atis: bool


def _decode(path: Path, frame: _Frame, report: DecodeReport) -> Iterator[Columns]:
    size, bottom, atis = frame
    state = np.zeros(7, np.int64)
    if path.stat().st_size == _HEADER.size:
        return
    data = np.memmap(path, np.uint8, "r", _HEADER.size)
    events = 0
    while True:
        t, x, y = (np.empty(_ROOM_EVENTS, np.int64) for _ in range(3))
        on = np.empty(_ROOM_EVENTS, np.bool_)
        count = _decode_bytes(data, state, (size.width_px, size.height_px, bottom), atis, t, x, y, on)
        if not count:
            break
        events += count
        yield Columns(t[:count], x[:count], y[:count], on[:count])
        report.share = int(state[_POSITION]) / len(data)
    outside, largest = int(state[_OUTSIDE]), (int(state[_MAX_X]), int(state[_MAX_Y]))
    refuse_many_outside(outside, events + outside, size, largest, path.name)
    lost, places = int(state[_LOST_BYTES]), int(state[_GAPS])
    if lost > ODD_SHARE * len(data):
        _refuse_wrong_size(data, size, atis, path)
    report.leave_out(OUTSIDE, outside, outside_note(outside, size, largest, path.name))
    note = f"{path.name}: {lost:,} bytes in {places:,} places are no events and were left out; how much time they took"
    report.leave_out("bytes that are no events", lost, f"{note} is not known.")
    rest = len(data) - int(state[_POSITION])
    note = f"{path.name}: the last {rest} bytes are not a whole event; the file was cut short."
    report.leave_out(CUT_SHORT, rest, note)


def _refuse_wrong_size(data: np.memmap, size: SensorSize, atis: bool, path: Path) -> None:
    """Refuse a sensor that is too small: with the largest there is, the same bytes would all be events.

    Raises:
        RecordingError: naming the size that would hold them.
    """
    found = _beyond(data, size, atis)
    if found.lost_bytes <= ODD_SHARE * len(data):
        refuse_many_outside(found.beyond, found.events, size, found.largest, path.name)


def _fits(path: Path, size: SensorSize, atis: bool) -> bool:
    """Whether all events but a few lie on a sensor of this size."""
    if path.stat().st_size == _HEADER.size:
        return True
    found = _beyond(np.memmap(path, np.uint8, "r", _HEADER.size), size, atis)
    return found.beyond <= allowed_odd(found.events)


class _Beyond(NamedTuple):
    """Events beyond a sensor, if the bytes are read as those of the largest one."""

    events: int
    beyond: int
    largest: tuple[int, int]
    lost_bytes: int


def _beyond(data: np.memmap, size: SensorSize, atis: bool) -> _Beyond:
    state = np.zeros(7, np.int64)
    largest, events, outside = (0, 0), 0, 0
    while True:
        t, x, y = (np.empty(_ROOM_EVENTS, np.int64) for _ in range(3))
        on = np.empty(_ROOM_EVENTS, np.bool_)
        count = _decode_bytes(data, state, (LARGEST_PX, LARGEST_PX, LARGEST_PX), atis, t, x, y, on)
        if not count:
            return _Beyond(events, outside, largest, int(state[_LOST_BYTES]))
        x, y = x[:count], LARGEST_PX - 1 - y[:count]
        beyond = (x >= size.width_px) | (y >= size.height_px)
        events, outside = events + count, outside + int(np.count_nonzero(beyond))
        if beyond.any():
            largest = max(largest[0], int(x[beyond].max())), max(largest[1], int(y[beyond].max()))


@njit
def _passed(byte, atis):
    """Time that a byte says has passed without an event; -1 for the first byte of an event."""
    if atis:
        return np.int64(63 * (byte & 3)) if byte >= 0xFC else np.int64(-1)
    return np.int64(127) if byte == 0xFF else np.int64(0) if byte == 0xFE else np.int64(-1)


@njit
def _is_in_step(data, at, width, height, atis):
    """Whether the next events from `at` on, if there are any, all lie inside the sensor."""
    seen = 0
    while seen < _IN_STEP and at < len(data):
        if _passed(data[at], atis) >= 0:
            at += 1
            continue
        if at + _EVENT_BYTES > len(data):
            break
        x = np.int64(data[at + 1]) | np.int64(data[at + 2]) << 8
        y = np.int64(data[at + 3]) | np.int64(data[at + 4]) << 8
        if x >= width or y >= height:
            return False
        at += _EVENT_BYTES
        seen += 1
    return True


@njit
def _zeros(data, at):
    """How many zeros follow each other from `at` on."""
    end = at
    while end < len(data) and data[end] == 0:
        end += 1
    return end - at


@njit
def _decode_bytes(data, state, size, atis, t, x, y, on):
    """Fill the columns as far as there is room; returns how many events there are."""
    width, height, bottom = size
    at, now = state[_POSITION], state[_TIME]
    events = 0
    while at < len(data) and events < len(t):
        byte = np.int64(data[at])
        passed = _passed(byte, atis)
        if passed >= 0:
            now += passed
            at += 1
            continue
        if at + _EVENT_BYTES > len(data):
            break
        zeros = _zeros(data, at) if byte == 0 else 0
        if zeros >= 2 * _EVENT_BYTES:  # no pixel has two events at one time
            state[_GAPS] += 1
            state[_LOST_BYTES] += zeros
            at += zeros
            continue
        column = np.int64(data[at + 1]) | np.int64(data[at + 2]) << 8
        row = np.int64(data[at + 3]) | np.int64(data[at + 4]) << 8
        if column >= width or row >= height:
            if _is_in_step(data, at + _EVENT_BYTES, width, height, atis):
                state[_OUTSIDE] += 1
                state[_MAX_X], state[_MAX_Y] = max(state[_MAX_X], column), max(state[_MAX_Y], row)
                now += byte >> (2 if atis else 1)
                at += _EVENT_BYTES
                continue
            start = at
            at += 1
            while at < len(data) and not _is_in_step(data, at, width, height, atis):
                at += 1
            state[_GAPS] += 1
            state[_LOST_BYTES] += at - start
            continue
        now += byte >> (2 if atis else 1)
        at += _EVENT_BYTES
        if atis and byte & 1:  # a measurement of brightness
            continue
        t[events], x[events], y[events] = now, column, bottom - 1 - row
        on[events] = (byte >> 1) & 1 if atis else byte & 1
        events += 1
    state[_POSITION], state[_TIME] = at, now
    return events
