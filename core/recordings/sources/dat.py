"""Prophesee DAT files: eight bytes an event, decoded here.

Source: Prophesee's DAT format description. Event type 0x0C holds events of change, 0x00 the same under an older number
(N-CARS, the first ATIS sets): a time of 32 bits in us, then 14 bits of column, 14 of row and the polarity in bit 28.
Files of version 1 have 9 bits of column, 8 of row and the polarity in bit 17 (toolbox of the first ATIS cameras).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.checking import CUT_SHORT, check_stream, note_padding, without_padding
from core.recordings.sources.making import make_source
from core.recordings.sources.prophesee_header import note_two_sizes, read_prophesee_header
from core.recordings.sources.source import Columns, DecodeReport, EventSource, FactOrigin

_EVENTS_OF_CHANGE: Final = (0x00, 0x0C)
"""Types of the events of a DVS: 2D, and CD."""
_EVENT_BYTES: Final = 8
_BLOCK_EVENTS: Final = 1 << 17
_CLOCK_US: Final = 1 << 32
_ATIS: Final = SensorSize(304, 240)
"""The only sensor of files of version 1."""
_ENOUGH_EVENTS: Final = 100


def open_dat(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of a Prophesee DAT file.

    Raises:
        RecordingError: if it holds other things than events of change.
    """
    header = read_prophesee_header(path)
    with path.open("rb") as file:
        file.seek(header.size_bytes)
        following = file.read(2)
    if len(following) < 2:
        raise RecordingError("the file cannot be decoded", got="a header alone", where=path)
    kind, size = following
    if kind not in _EVENTS_OF_CHANGE or size != _EVENT_BYTES:
        expected = "events of type 0x00 or 0x0C, 8 bytes each"
        got = f"type 0x{kind:02X}, {size} bytes"
        raise RecordingError("a DAT file without events of change", expected=expected, got=got, where=path)
    start = header.size_bytes + 2
    old = _is_version_1(path, start, header.dat_version)
    size_given = sensor is not None
    sensor = sensor or header.sensor or (_ATIS if old else None)

    def decode(report: DecodeReport) -> Iterator[Columns]:
        if not size_given:
            note_two_sizes(header, path.name, report)
        if old and header.dat_version is None:
            report.assume(f"{path.name} names no version of DAT; by its addresses it is taken for version 1.")
        return _decode(path, start, report, old=old)

    def check(parts, sensor, report, *, where):
        return check_stream(parts, sensor, report, where=where, clock_lengths_us=(_CLOCK_US,))

    origin = FactOrigin.CAMERA if header.sensor is None or header.sensor_by_camera else FactOrigin.FILE
    return [make_source(path, "camera", "Prophesee DAT", sensor, decode, check, sensor_from=origin)]


def _is_version_1(path: Path, start: int, version: int | None) -> bool:
    """By the header; without a version, by addresses of which none needs more than 18 bits."""
    if version is not None:
        return version < 2
    with path.open("rb") as file:
        file.seek(start)
        data = file.read(_BLOCK_EVENTS * _EVENT_BYTES)
    words = np.frombuffer(data, "<u4", 2 * (len(data) // _EVENT_BYTES))[1::2]
    return len(words) >= _ENOUGH_EVENTS and not (words >> 18).any()


def _decode(path: Path, start: int, report: DecodeReport, *, old: bool) -> Iterator[Columns]:
    # Version 1 has 9 bits of column, 8 of row and the polarity in bit 17; version 2 has 14, 14 and bit 28.
    columns, rows, polarity = ((0, 0x1FF), (9, 0xFF), 17) if old else ((0, 0x3FFF), (14, 0x3FFF), 28)
    end = path.stat().st_size
    done, padding = start, 0
    with path.open("rb") as file:
        file.seek(start)
        while data := file.read(_BLOCK_EVENTS * _EVENT_BYTES):
            words = np.frombuffer(data, "<u4", 2 * (len(data) // _EVENT_BYTES)).reshape(-1, 2)
            words, empty = without_padding(words)
            padding += empty
            t, address = words[:, 0].astype(np.int64), words[:, 1]
            x, y = ((address >> shift) & mask for shift, mask in (columns, rows))
            yield Columns(t, x, y, (address >> polarity) & 1 == 1)
            done += len(data)
            report.share = done / end
    note_padding(padding, path.name, report)
    rest = (end - start) % _EVENT_BYTES
    note = f"{path.name}: the last {rest} bytes are not a whole event; the file was cut short."
    report.leave_out(CUT_SHORT, rest, note)
