"""AEDAT 3.0 and 3.1 of cAER: text lines, then little-endian packets, a header of 28 bytes each and events of one size.

Of a polarity event the first word is: bit 0 valid, bit 1 ON, bits 2-16 y, bits 17-31 x; the second its time in us,
31 bits, above which the packet's header counts. Source: the Matlab readers of SensorsINI and iniVation's description.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.checking import CUT_SHORT, check_stream
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource, FactOrigin

_END: Final = b"#!END-HEADER"
_MAX_HEADER: Final = 1 << 20
_SOURCE: Final = re.compile(rb"#\s*Source\s+(\d+):\s*([A-Za-z]+\d+)")
_PACKET: Final = struct.Struct("<2h6i")
"""Type, source, bytes of an event, offset of its time, high bits of the times, capacity, number, number of valid."""
_LARGEST_EVENT: Final = 64 << 20
_SPECIAL, _POLARITY = 0, 1
_RISING, _FALLING = 2, 3
_CAMERAS: Final = {
    "DVS128": SensorSize(128, 128),
    "DAVIS128": SensorSize(128, 128),
    "DAVIS208": SensorSize(208, 192),
    "DAVIS240": SensorSize(240, 180),
    "DAVIS346": SensorSize(346, 260),
    "DAVIS640": SensorSize(640, 480),
    "DVS132": SensorSize(132, 104),
}


def open_aedat3(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """Every camera of the file: cAER writes those of several into one, packet by packet.

    Raises:
        RecordingError: if its header does not end.
    """
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER)
    end = head.find(b"\n", head.find(_END)) + 1 if _END in head else 0
    if not end:
        raise RecordingError("the AEDAT 3 header has no end", expected=_END.decode(), where=path)
    named = {int(number): name.decode().upper() for number, name in _SOURCE.findall(head[:end])}
    numbers = _sources_with_events(path, end) or [next(iter(named), 1)]
    if len(numbers) == 1 and len(named) == 1:  # files edited by hand number it otherwise
        named = {numbers[0]: next(iter(named.values()))}
    sources: list[EventSource] = []
    for number in numbers:
        alone = len(numbers) == 1
        name = "camera" if alone else f"camera{number}"
        size = sensor or _CAMERAS.get(named.get(number, ""))
        origin = FactOrigin.FILE if sensor is not None else FactOrigin.CAMERA
        # External edges of whatever source belong to the one camera that there is.
        decode = partial(_decode, path, end, None if alone else number)
        sources.append(make_source(path, name, "AEDAT 3", size, decode, check_stream, sensor_from=origin))
    return sources


def _sources_with_events(path: Path, start: int) -> list[int]:
    """The numbers of the cameras of which there are polarity events, in order."""
    with path.open("rb") as file:
        file.seek(start)
        found: set[int] = set()
        while (header := _read_header(file)) is not None:
            if header.kind == _POLARITY and header.number:
                found.add(header.source)
            file.seek(header.length, 1)
    return sorted(found)


def _decode(path: Path, start: int, source: int | None, report: DecodeReport) -> Iterator[Columns]:
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(start)
        while True:
            at = file.tell()
            report.share = min(1.0, at / max(1, size))
            header = _read_header(file)
            if header is None:
                note = f"{path.name}: stopped at byte {at:,}: no whole packet follows."
                report.leave_out(CUT_SHORT, max(0, size - at), note)
                return
            passed_over = header.kind not in (_SPECIAL, _POLARITY)  # pictures, the IMU and others
            if passed_over or source not in (None, header.source):
                file.seek(header.length, 1)
                continue
            content = file.read(header.length)
            count = len(content) // header.size
            note = f"{path.name}: its last packet is cut short and holds {count:,} of {header.number:,} events."
            report.leave_out("missing events", header.number - count, note)
            rows = np.frombuffer(content, np.uint8, count * header.size).reshape(count, header.size)
            words, times = (
                np.ascontiguousarray(rows[:, first : first + 4]).view("<u4").ravel().astype(np.int64)
                for first in (0, header.time_at)
            )
            valid = (words & 1).astype(np.bool_)
            words, t_us = words[valid], times[valid] + (header.overflow << 31)
            if header.kind == _POLARITY:
                yield Columns(t_us, words >> 17, (words >> 2) & 0x7FFF, (words & 2) != 0)
            else:
                code = (words >> 1) & 0x7F
                edge = (code == _RISING) | (code == _FALLING)
                report.add_triggers(t_us[edge], code[edge] == _RISING, np.zeros(int(edge.sum())))


@dataclass(frozen=True, slots=True)
class _Header:
    """The header of a packet."""

    kind: int
    source: int
    size: int
    """Bytes of an event."""
    time_at: int
    overflow: int
    number: int
    """Events in the packet."""

    @property
    def length(self) -> int:
        """Bytes of the events."""
        return self.size * self.number


def _read_header(file: BinaryIO) -> _Header | None:
    """The header of the next packet; None where none follows."""
    head = file.read(_PACKET.size)
    if len(head) < _PACKET.size:
        return None
    kind, source, size, time_at, overflow, capacity, number, _ = _PACKET.unpack(head)
    if kind < 0 or overflow < 0:
        return None
    if not (8 <= size <= _LARGEST_EVENT and 0 <= number <= capacity and 0 <= time_at <= size - 4):
        return None
    return _Header(kind, source, size, time_at, overflow, number)
