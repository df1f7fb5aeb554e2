"""Writes the raw data of cameras, a RAW file for each; a recording is made of them at the end.

Nothing is decoded meanwhile: each camera has a thread that takes bytes from the driver and gives them to the operating
system. If the disk is slower than the camera for some seconds, they wait in the driver's memory (512 MB a camera with a
Prophesee); what finds no room there is lost, and the driver says how many of its packets that were, and where.
After a kill the files are there, up to the last half second: `rallyscope import` makes a recording of them.

EVT3 bytes without decoding: the time at their end, and where to resume after a gap. Source: Prophesee's EVT3 format
description: 16-bit words, the upper four bits their kind.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from core.devices.camera_device import RawDevice, RawPacket
from core.devices.clock_fit import ClockEstimate, ClockFit, ClockShift
from core.errors import WRITE_REMEDY, DeviceError, RallyscopeError, RecordingError
from core.events.clock_table import COLUMNS
from core.files import beside
from core.recordings.evt3_encoder import evt3_header

logger = logging.getLogger(__name__)


ROW, COLUMN, VECTOR_12, VECTOR_8, TIME_LOW, TIME_HIGH, TRIGGER = 0x0, 0x2, 0x4, 0x5, 0x6, 0x8, 0xA
TAIL: Final = 4096
"""Words at the end that are looked at first: cameras repeat the time much more often."""


class Evt3Clock:
    """The time at the end of each piece of a stream, from its first coarse time on; as the decoder counts it."""

    def __init__(self) -> None:
        self._high = -1
        self._epoch = self._low = 0

    def after(self, words: NDArray[np.uint16]) -> int | None:
        """Microseconds; None before there was a coarse time. Call it for every piece, in order."""
        for part in (words[-TAIL:], words):
            kinds = part >> 12
            highs = np.flatnonzero(kinds == TIME_HIGH)
            if len(highs):
                break
        since = 0
        if len(highs):
            since, high = int(highs[-1]), int(part[highs[-1]]) & 0xFFF
            ahead = (high - self._high) & 0xFFF
            if self._high < 0 or ahead < 0x800:  # else it is damaged, or the clock went back
                self._epoch += self._high >= 0 and high < self._high
                if ahead:
                    self._low = 0
                self._high = high
        lows = np.flatnonzero(kinds[since:] == TIME_LOW)
        if len(lows):
            self._low = int(part[since + lows[-1]]) & 0xFFF
        return None if self._high < 0 else (self._epoch << 24) + (self._high << 12) + self._low


class GapResynchroniser:
    """After a gap row and time are unknown: removes events until the stream has stated both."""

    def __init__(self) -> None:
        self.events_left_out = 0
        self._has_time = self._has_row = True

    def begin_gap(self) -> None:
        """Note that data is missing before the next piece."""
        self._has_time = self._has_row = False

    def fix(self, words: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Next words without events of unknown position or time."""
        if self._has_row:
            return words
        kinds = words >> 12
        first = 0
        if not self._has_time:
            highs = np.flatnonzero(kinds == TIME_HIGH)
            self._has_time = len(highs) > 0
            first = int(highs[0]) if self._has_time else len(words)
        rows = np.flatnonzero(kinds[first:] == ROW)
        self._has_row = len(rows) > 0 and self._has_time
        until = first + int(rows[0]) if self._has_row else len(words)
        self.events_left_out += count_events(words[:until])
        kept = np.isin(kinds[:until], (TIME_LOW, TIME_HIGH))
        kept[:first] = False
        return np.concatenate([words[:until][kept], words[until:]])


def count_events(words: NDArray[np.uint16]) -> int:
    """Number of events in some words."""
    kinds = words >> 12
    events = int((kinds == COLUMN).sum())
    for kind, mask in ((VECTOR_12, 0xFFF), (VECTOR_8, 0xFF)):
        events += int(np.bitwise_count(words[kinds == kind] & mask).sum())
    return events


BUFFER_BYTES: Final = 1 << 20
FLUSH_S: Final = 0.5
SETTLE_US: Final = 1_000_000
"""Time until the shift between two clocks is known well."""
ROW_US: Final = 1_000_000
"""From one row of the table of clocks to the next."""


@dataclass(frozen=True, slots=True)
class RawTake:
    """Result of one camera."""

    name: str
    path: Path
    bytes_written: int
    packets_dropped: int
    """Packets dropped because the driver's buffer was full and this machine too busy."""
    gaps: int
    events_left_out: int
    """Events removed after gaps, until their position was known again."""
    problem: str
    """Why it ended early; empty if it did not."""
    clock: ClockEstimate | None


class RawRecorder:
    """Records from its creation until `stop`. It owns the cameras and closes them."""

    def __init__(self, devices: Mapping[str, RawDevice], out: Path, *, cable: bool = False, overwrite: bool = False):
        """Begin. The files stand beside `out`, which is not written here: OUT.left.raw and so on.

        Raises:
            RecordingError: if there are such files already, or they cannot be made; the cameras are closed then.
        """
        followers = [] if cable else list(devices)[1:]
        self.clock_paths = {name: _beside(out, f"{name}.clock.csv") for name in followers}
        """How the clock of each camera after the first drifted from the first's; none where they are one."""
        self._files: list[_CameraFile] = []
        try:
            reference: ClockFit | None = None
            for name, device in devices.items():
                one = _CameraFile(name, device, raw_path(out, name), overwrite=overwrite)
                self._files.append(one)
                if name in self.clock_paths:
                    one.write_clock(ClockShift(one.clock, reference), self.clock_paths[name])
                reference = reference or one.clock
        except BaseException:
            for one in self._files:
                one.discard()
            for device in devices.values():
                device.close()
            raise
        for one in self._files:
            # All files exist before the first camera sends: a name that is taken ends it without a file left.
            one.start()

    @property
    def paths(self) -> list[Path]:
        """The files that are being written."""
        return [one.path for one in self._files]

    @property
    def over(self) -> bool:
        """Whether no camera is left, or nothing more can be written."""
        return all(one.problem is not None for one in self._files) or self.error is not None

    @property
    def error(self) -> RallyscopeError | None:
        """Error that stopped writing; None if none."""
        return next((one.problem for one in self._files if isinstance(one.problem, RecordingError)), None)

    @property
    def bytes_written(self) -> int:
        """Bytes written, all cameras."""
        return sum(one.bytes_written for one in self._files)

    def stop(self) -> tuple[RawTake, ...]:
        """End the threads, close files and cameras."""
        for one in self._files:
            one.end()
        return tuple(one.take() for one in self._files)


class _CameraFile:
    """One camera and its file, with the thread between them."""

    def __init__(self, name: str, device: RawDevice, path: Path, *, overwrite: bool) -> None:
        self.name, self.path, self.clock = name, path, ClockFit()
        self.problem: RallyscopeError | None = None
        self.bytes_written = 0
        self._device = device
        self._words, self._mender = Evt3Clock(), GapResynchroniser()
        self._stamp_us: int | None = None
        self._dropped = self._gaps = 0
        self._shift: ClockShift | None = None
        self._table: BinaryIO | None = None
        self._row_us = 0
        self._stop = False
        self._file = _create(path, overwrite=overwrite)
        self._put(_header(device))
        self._thread = threading.Thread(target=self._run, name=f"record-{name}", daemon=True)

    def write_clock(self, shift: ClockShift, path: Path) -> None:
        """Write a row a second of how its clock is to be shifted."""
        self._table = _create(path, overwrite=True)
        self._table.write(f"{COLUMNS}\n".encode())
        self._shift = shift

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._stop = True
        self._thread.join()

    def discard(self) -> None:
        self._file.close()
        self.path.unlink(missing_ok=True)

    def take(self) -> RawTake:
        problem = "" if self.problem is None else str(self.problem)
        left_out = self._mender.events_left_out
        estimate = self.clock.estimate
        return RawTake(self.name, self.path, self.bytes_written, self._dropped, self._gaps, left_out, problem, estimate)

    def _run(self) -> None:
        flushed_s = time.monotonic()
        try:
            while not self._stop:
                packet = self._device.read_raw()
                if packet is not None:
                    self._write(packet)
                if time.monotonic() - flushed_s > FLUSH_S:
                    self._flush()
                    flushed_s = time.monotonic()
        except RallyscopeError as error:
            self.problem = error
        except OSError as error:
            self.problem = _cannot_write(self.path, error)
        except Exception:
            logger.exception("recording camera %s failed", self.name)
            self.problem = DeviceError("this is a bug; the terminal shows where", where=self.name)
        finally:
            self._close()

    def _write(self, packet: RawPacket) -> None:
        self._dropped = packet.packets_dropped
        words = np.frombuffer(packet.data, "<u2")
        if packet.gaps:
            self._gaps += len(packet.gaps)
            places = [0, *(place // 2 for place in packet.gaps), len(words)]
            for number, (first, last) in enumerate(itertools.pairwise(places)):
                if number:
                    self._mender.begin_gap()
                self._put(self._mender.fix(words[first:last]).tobytes())
        else:
            fixed = self._mender.fix(words)
            self._put(packet.data if fixed is words else fixed.tobytes())
        before_us, self._stamp_us = self._stamp_us, self._words.after(words)
        known_us = self._stamp_us if packet.alone else before_us
        if known_us is not None:
            self.clock.add(known_us, packet.host_s * 1e6)
            self._tell_clock(known_us)

    def _tell_clock(self, stamp_us: int, *, settled: bool = True) -> None:
        estimate = self.clock.estimate
        if self._shift is None or self._table is None or estimate is None:
            return
        if settled and estimate.span_us < SETTLE_US:
            return
        if stamp_us >= self._row_us and (shift_us := self._shift.shift_us(stamp_us)) is not None:
            self._table.write(f"{stamp_us},{shift_us}\n".encode())
            self._row_us = stamp_us + ROW_US

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self.bytes_written += len(data)

    def _flush(self) -> None:
        self._file.flush()
        if self._table is not None:
            self._table.flush()

    def _close(self) -> None:
        try:
            self._device.close()
        except RuntimeError as error:
            logger.info("camera %s was not closed: %s", self.name, error)
        if not self._row_us and self._stamp_us is not None:  # it was short: an early estimate is better than none
            self._tell_clock(self._stamp_us, settled=False)
        for file in (self._file, self._table):
            try:
                if file is not None:
                    file.close()
            except OSError as error:
                self.problem = self.problem or _cannot_write(self.path, error)


def raw_path(out: Path, name: str) -> Path:
    """Path of a camera's raw file beside the recording."""
    return _beside(out, f"{name}.raw")


def _beside(out: Path, ending: str) -> Path:
    return beside(out.with_suffix(""), "", f".{ending}")


def _create(path: Path, *, overwrite: bool) -> BinaryIO:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open("wb" if overwrite else "xb", buffering=BUFFER_BYTES)
    except FileExistsError as error:
        remedy = "it is of a recording that was cut short: see `rallyscope import`; or choose another name, or --force"
        raise RecordingError("the file exists", where=path, remedy=remedy) from error
    except OSError as error:
        raise _cannot_write(path, error) from error


def _cannot_write(path: Path, error: OSError) -> RecordingError:
    return RecordingError("cannot write what the camera sends", got=error.strerror, where=path, remedy=WRITE_REMEDY)


def _header(device: RawDevice) -> bytes:
    """With serial number, model and biases, which readers that do not know them pass over."""
    lines = [f"serial_number {device.serial}", f"camera {device.model.name}"]
    lines += [f"bias_{name} {value}" for name, value in device.bias_values().items()]
    plain = "".join(f"% {line}\n" for line in lines).encode("ascii", "replace")
    return evt3_header(device.model.sensor).replace(b"% end\n", plain + b"% end\n")
