"""AEDAT 3.0 and 3.1 of cAER: text lines, then little-endian packets, a header of 28 bytes each and events of one size.

Of a polarity event the first word is: bit 0 valid, bit 1 ON, bits 2-16 y, bits 17-31 x; the second its time in us,
31 bits, above which the packet's header counts. Source: the Matlab readers of SensorsINI and iniVation's description.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.checking import CUT_SHORT, check_stream
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource, FactOrigin

_END: Final = b"#!END-HEADER"
_MAX_HEADER: Final = 1 << 20
_PACKET: Final = np.dtype(
    [
        ("type", "<i2"), ("source", "<i2"), ("size", "<i4"), ("time_at", "<i4"), ("overflow", "<i4"),
        ("capacity", "<i4"), ("number", "<i4"), ("valid", "<i4"),
    ]
)  # fmt: skip
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
    """The one camera of the file.

    Raises:
        RecordingError: if its header does not end.
    """
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER)
    end = head.find(b"\n", head.find(_END)) + 1 if _END in head else 0
    if not end:
        raise RecordingError("the AEDAT 3 header has no end", expected=_END.decode(), where=path)
    named = re.search(rb"#\s*Source\s+\d+:\s*([A-Za-z]+\d+)", head[:end])
    known = _CAMERAS.get(named[1].decode().upper()) if named is not None else None
    size = sensor or known
    origin = FactOrigin.FILE if sensor is not None else FactOrigin.CAMERA
    return [
        make_source(
            path, "camera", "AEDAT 3", size, lambda report: _decode(path, end, report), check_stream, sensor_from=origin
        )
    ]


def _decode(path: Path, start: int, report: DecodeReport) -> Iterator[Columns]:
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(start)
        while True:
            at = file.tell()
            report.share = at / max(1, size)
            packet = _read_packet(file)
            if packet is None:
                report.leave_out(CUT_SHORT, size - at, f"{path.name}: stopped at byte {at:,}: no whole packet follows.")
                return
            kind, words, t_us = packet
            valid = (words & 1).astype(np.bool_)
            words, t_us = words[valid], t_us[valid]
            if kind == _POLARITY:
                yield Columns(t_us, words >> 17, (words >> 2) & 0x7FFF, (words & 2) != 0)
            elif kind == _SPECIAL:
                code = (words >> 1) & 0x7F
                edge = (code == _RISING) | (code == _FALLING)
                report.add_triggers(t_us[edge], code[edge] == _RISING, np.zeros(int(edge.sum())))


def _read_packet(file: BinaryIO) -> tuple[int, NDArray[np.int64], NDArray[np.int64]] | None:
    """Type, first words and times of the events of the next packet; None where no whole one follows."""
    head = file.read(_PACKET.itemsize)
    if len(head) < _PACKET.itemsize:
        return None
    header = np.frombuffer(head, _PACKET)[0]
    size, number, time_at = (int(header[name]) for name in ("size", "number", "time_at"))
    if not (8 <= size <= _LARGEST_EVENT and 0 <= number <= int(header["capacity"]) and 0 <= time_at <= size - 4):
        return None
    if header["overflow"] < 0:
        return None
    if header["type"] not in (_SPECIAL, _POLARITY):  # pictures, the IMU and others are passed over
        file.seek(size * number, 1)
        none = np.empty(0, np.int64)
        return int(header["type"]), none, none
    content = file.read(size * number)
    rows = np.frombuffer(content[: len(content) // size * size], np.uint8).reshape(-1, size)
    words, times = (
        np.ascontiguousarray(rows[:, at : at + 4]).view("<u4").ravel().astype(np.int64) for at in (0, time_at)
    )
    return int(header["type"]), words, times + (int(header["overflow"]) << 31)
