"""AEDAT 2.0 and 1.0 of jAER: big-endian pairs of an address and a time in us, after header lines that begin with #.

What the bits of an address mean depends on the camera, which the header names (AEChip).
    DVS128   x: bits 1-7, y: bits 8-14, OFF: bit 0; any higher bit: an external event
    DAVIS    x: bits 12-21, y: bits 22-30, ON: bit 11; bit 10: an external event; bit 31: a picture or the IMU
Sources: iniVation's description of the format; jAER's extractors of DVS128 and DAVIS, where the column counts from the
right and the row from the bottom.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.checking import CUT_SHORT, check_stream, note_padding, without_padding
from core.recordings.sources.making import make_source
from core.recordings.sources.source import (
    MICROSECONDS,
    POLARITY,
    TIME_UNIT,
    Columns,
    DecodeReport,
    EventSource,
    Fact,
    FactOrigin,
)


class RunningClock:
    """Unwraps the times of a counter, part after part."""

    def __init__(self, length: int) -> None:
        """`length` is the value at which the counter begins again at 0."""
        self._length = length
        self._usual: int | None = None
        self.wraps = 0
        """How often the counter has begun again."""

    def unwrap(self, t: NDArray[np.int64]) -> NDArray[np.int64]:
        """The times as if the counter had more bits.

        The median of five neighbours tells where it began again; each time gets the epoch that brings it next to them.
        """
        if not len(t):
            return t
        usual = np.median(sliding_window_view(np.pad(t, 2, mode="edge"), 5), axis=1).astype(np.int64)
        before = usual[0] if self._usual is None else self._usual % self._length
        epoch = 0 if self._usual is None else self._usual - before
        steps = np.diff(usual, prepend=before)
        half = self._length // 2
        wraps = np.cumsum((steps < -half).astype(np.int64) - (steps > half))
        self.wraps += max(0, int(wraps[-1]))
        usual += epoch + self._length * wraps
        self._usual = int(usual[-1])
        return t + self._length * np.rint((usual - t) / self._length).astype(np.int64)


_VERSION_1: Final = b"#!AER-DAT1.0"
_MAX_HEADER: Final = 16 << 20
"""jAER writes all its preferences into it."""
_ROWS: Final = 1 << 17
_RUN: Final = 64
"""Rows in order that are taken for right behind a break."""
_LATE_US: Final = 50_000
_LONGEST_GAP_US: Final = 10_000_000
"""Steps of time from one row to the next that are no break."""
_LONGEST_STEP_US: Final = 1_000_000
_RATE_FACTOR: Final = 16
"""Behind a break times go on by such steps, and no more than so many times faster or slower: those of bytes that are
out of place by one are 256 times as fast or slow.
"""
_MOST_BREAKS: Final = 100
"""Breaks in a block behind which the order is looked for."""
_FARTHEST_BYTES: Final = 1024
"""How far behind lost bytes the next whole row is looked for."""
_WRAP: Final = 1 << 32
_DVS128: Final = SensorSize(128, 128)
_DAVIS: Final = {"240": SensorSize(240, 180), "346": SensorSize(346, 260)}


@dataclass(frozen=True, slots=True)
class _Camera:
    name: str
    sensor: SensorSize
    davis: bool


@dataclass(frozen=True, slots=True)
class _Header:
    size_bytes: int
    chip: str | None
    row: np.dtype


def open_aedat2(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file.

    Raises:
        RecordingError: if neither the header nor `sensor` tells which camera it was.
    """
    header = _read_header(path)
    camera = _camera_of(header.chip, sensor, path)
    label = f"AEDAT {'2.0' if header.row.itemsize == 8 else '1.0'}, {camera.name}"

    def decode(report: DecodeReport) -> Iterator[Columns]:
        if header.chip is None:
            report.assume(f"{path.name} does not name its camera; by its size it is taken for a {camera.name}.")
        if not camera.davis:
            report.assume(f"{path.name}: bit 0 of an address is OFF, as in jAER, not as iniVation describes it.")
        yield from _decode(path, header, camera, report)

    def check(parts, sensor, report, *, where):
        return check_stream(parts, sensor, report, where=where, clock_lengths_us=(_WRAP >> 1,))

    polarity = (
        Fact("0 = OFF, 1 = ON", FactOrigin.FORMAT) if camera.davis else Fact("0 = ON, 1 = OFF", FactOrigin.ASSUMED)
    )
    origin = (
        FactOrigin.CAMERA if header.chip is not None else FactOrigin.OPTION
    )  # without a name the size tells the camera
    facts = {TIME_UNIT: MICROSECONDS, POLARITY: polarity}
    return [make_source(path, "camera", label, camera.sensor, decode, check, sensor_from=origin, facts=facts)]


def _read_header(path: Path) -> _Header:
    with path.open("rb") as file:
        head = file.read(_MAX_HEADER)
    size, chip = 0, None
    while head[size : size + 1] == b"#":
        end = head.find(b"\n", size)
        if end < 0:
            break
        line = head[size:end].decode("latin-1").strip("# \r")
        size = end + 1
        if line.startswith("AEChip:"):
            chip = line.partition(":")[2].strip()
        if line.lower() == "end of ascii header":  # the first address may begin like a line of the header
            break
    wide = ">u2" if head.startswith(_VERSION_1) else ">u4"
    return _Header(size, chip, np.dtype([("address", wide), ("t", ">u4")]))


def _camera_of(chip: str | None, sensor: SensorSize | None, path: Path) -> _Camera:
    known = "DVS128, DAVIS240 or DAVIS346"
    if chip is None:
        if sensor is None:
            remedy = "give --width and --height: 128 128, 240 180 or 346 260"
            raise RecordingError("the header does not name the camera (AEChip)", where=path, remedy=remedy)
        if sensor == _DVS128:
            return _Camera("DVS128", sensor, davis=False)
        name = next((name for name, size in _DAVIS.items() if size == sensor), None)
        if name is None:
            raise RecordingError("no camera of this size is known", expected=known, got=sensor, where=path)
        return _Camera(f"DAVIS{name}", sensor, davis=True)
    short = chip.rsplit(".", 1)[-1].lower()
    if short.startswith(("dvs128", "tmpdiff128")):
        found = _Camera("DVS128", _DVS128, davis=False)
    else:
        name = next((name for name in _DAVIS if short.startswith(f"davis{name}")), None)
        if name is None:
            raise RecordingError("the addresses of this camera are not known", expected=known, got=chip, where=path)
        found = _Camera(f"DAVIS{name}", _DAVIS[name], davis=True)
    if sensor is not None and sensor != found.sensor:
        got = f"{sensor} for a {found.name} of {found.sensor}"
        remedy = "leave out --width and --height"
        raise RecordingError("the size contradicts the header", got=got, where=path, remedy=remedy)
    return found


def _decode(path: Path, header: _Header, camera: _Camera, report: DecodeReport) -> Iterator[Columns]:
    clock, skipped, padding, displaced, cut = RunningClock(_WRAP), 0, 0, 0, 0
    size, over = header.row.itemsize, b""
    with path.open("rb") as file:
        end = os.fstat(file.fileno()).st_size
        done = file.seek(header.size_bytes)
        while (data := file.read(_ROWS * size)) or over:
            done += len(data)
            ends = done >= end or not data
            data, bytes_out = _realigned(over + data, header.row)
            displaced += bytes_out
            whole = len(data) // size * size
            held_back = 0 if ends else min(whole, _RUN * size)  # what begins there is judged with what follows
            rows = np.frombuffer(data[: whole - held_back], header.row)
            cut, over = len(data) - whole, b"" if ends else data[whole - held_back :]
            rows, empty = without_padding(rows)
            padding += empty
            t_us = clock.unwrap(rows["t"].astype(np.int64))
            address = rows["address"].astype(np.int64)
            pixels, external = _kinds(address, camera)
            skipped += len(rows) - int(pixels.sum()) - int(external.sum())
            _add_triggers(t_us[external], address[external], camera, report)
            yield _pixels(t_us[pixels], address[pixels], camera)
            report.share = (done - header.size_bytes) / max(1, end - header.size_bytes)
    note_padding(padding, path.name, report)
    note = f"{path.name}: the clock began again at 0 {clock.wraps} times; its time runs on."
    report.change("clock began again", clock.wraps, note)
    note = f"{path.name}: bytes were lost or added; {displaced} bytes there were left out."
    report.leave_out("bytes out of place", displaced, note)
    report.leave_out(CUT_SHORT, cut, f"{path.name}: the last bytes are no whole event; the file was cut short.")
    note = f"{path.name}: {skipped:,} samples of pictures and of the IMU were left out."
    report.leave_out("pictures and IMU", skipped, note)


def _realigned(data: bytes, row: np.dtype) -> tuple[bytes, int]:
    """The data with whole rows again behind bytes that were lost or added, and how many bytes are left out for that.

    There two times or more leave the order, and they go on in order a few bytes further.
    """
    left_out, size, first = 0, row.itemsize, 0
    while True:
        t = np.frombuffer(data, row, len(data) // size)["t"][first:].astype(np.int64)
        steps = np.stack([t[1:-1], t[2:]]) - t[:-2]
        apart = ((steps < -_LATE_US) | (steps > _LONGEST_GAP_US)).all(axis=0)
        for k in np.flatnonzero(apart)[:_MOST_BREAKS].tolist():
            start = (first + k + 1) * size
            end = _next_in_order(data, start, t[max(0, k - _RUN + 1) : k + 1], row)
            if end is not None:
                data, left_out, first = data[:start] + data[end:], left_out + end - start, first + k
                break
        else:
            return data, left_out


def _next_in_order(data: bytes, start: int, before_us: NDArray[np.int64], row: np.dtype) -> int | None:
    """The byte behind `start` from which times go on in order and as fast as `before_us`; None if none is near."""
    found: dict[int, int] = {}
    last_us, span_us = int(before_us[-1]), int(np.ptp(before_us))
    for end in range(start + 1, min(start + _FARTHEST_BYTES, len(data) - _RUN * row.itemsize)):
        t = np.frombuffer(data, row, _RUN, end)["t"].astype(np.int64)
        steps = np.diff(t, prepend=last_us)
        in_order = ((steps >= -_LATE_US) & (steps <= _LONGEST_STEP_US)).all()
        if in_order and span_us <= _RATE_FACTOR * np.ptp(t) and np.ptp(t) <= _RATE_FACTOR * (span_us + _RUN):
            found[end] = int(np.abs(t - last_us).sum())
    return min(found, key=found.__getitem__) if found else None


def _kinds(address: NDArray[np.int64], camera: _Camera) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which rows are events of pixels, and which external ones."""
    if not camera.davis:
        return address >> 15 == 0, address >> 15 != 0
    dvs = address >> 31 == 0
    external = dvs & ((address >> 10) & 1 == 1)
    return dvs & ~external, external


def _add_triggers(t_us: NDArray[np.int64], address: NDArray[np.int64], camera: _Camera, report: DecodeReport) -> None:
    """Edges at the input of the camera; a DAVIS tells by the lowest bits which: 2 is a falling one."""
    rising = (address & 0x3FF) != 2 if camera.davis else np.ones(len(t_us), np.bool_)
    report.add_triggers(t_us, rising, np.zeros(len(t_us), np.int16))


def _pixels(t_us: NDArray[np.int64], address: NDArray[np.int64], camera: _Camera) -> Columns:
    """Events with the column from the left and the row from the top, as everywhere here."""
    if camera.davis:
        x, y, on = (address >> 12) & 0x3FF, (address >> 22) & 0x1FF, (address >> 11) & 1 == 1
    else:
        x, y, on = (address >> 1) & 0x7F, (address >> 8) & 0x7F, address & 1 == 0
    return Columns(t_us, camera.sensor.width_px - 1 - x, camera.sensor.height_px - 1 - y, on)
