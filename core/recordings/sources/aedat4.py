"""AEDAT4 files, decoded in a process of its own (`aedat4_worker` says why).

A packet that cannot be decoded is left out and counted; one that takes the process down with it is passed over by a new
process.
"""

from __future__ import annotations

import select
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.checking import check_stream
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource
from core.text import parse_json

_WORKER: Final = Path(__file__).with_name("aedat4_worker.py")
_SILENCE_S: Final = 60
"""A decoder that says nothing for so long hangs."""
_MAX_BROKEN: Final = 20
"""So many packets may take the decoder down before the rest is given up."""
_HEAD: Final = struct.Struct("<cQ")
_BYTES_PER_EVENT: Final = 8
"""Size of an event in a file, for the progress only: the worker does not tell how far it is."""


def open_aedat4(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """Every camera of an iniVation AEDAT4 file, with external trigger edges."""
    info = _ask(path)
    if not info.tracks:
        raise RecordingError("the AEDAT4 file holds no events", where=path)
    sources: list[EventSource] = []
    for position, track in enumerate(info.tracks):
        name = "camera" if len(info.tracks) == 1 else f"camera{track.number}"
        decode = _decoder(path, track.number, info.others, None if position else info.rest)
        sources.append(make_source(path, name, "AEDAT4", sensor or track.sensor, decode, check_stream))
    return sources


@dataclass(frozen=True, slots=True)
class _Track:
    number: int
    sensor: SensorSize | None


@dataclass(frozen=True, slots=True)
class _Info:
    tracks: list[_Track]
    others: list[str]
    """Kinds of data that are not read: frames, imus."""
    rest: Iterator[tuple[bytes, bytes]]
    """What the worker goes on to say: the events of the first track."""


def _ask(path: Path) -> _Info:
    """What the file holds."""
    messages = _messages(path, None, 0)
    message, content = next(messages, (b"X", b"nothing was found"))
    if message != b"I":
        raise RecordingError("the file cannot be decoded", got=content.decode("utf-8", "replace"), where=path)
    found = parse_json(content)
    tracks = [_Track(n, SensorSize(w, h) if w and h else None) for n, w, h in found["tracks"]]
    return _Info(tracks, found["others"], messages)


def _decoder(
    path: Path, track: int, others: list[str], started: Iterator[tuple[bytes, bytes]] | None
) -> Callable[[DecodeReport], Iterator[Columns]]:
    """Decodes the track; the first time with the worker that was `started` already."""
    workers = [] if started is None else [started]

    def decode(report: DecodeReport) -> Iterator[Columns]:
        size, done = max(1, path.stat().st_size), 0
        lost: list[str] = []
        start, broken = 0, 0
        while True:
            messages = workers.pop() if workers else _messages(path, track, start)
            reason = None
            for message, content in messages:
                if message == b"E":
                    columns = _columns(content)
                    yield columns
                    done += len(columns.t_us)
                    report.share = min(0.99, _BYTES_PER_EVENT * done / size)
                elif message == b"T":
                    _add_triggers(content, report)
                elif message == b"N":
                    start = int.from_bytes(content, "little")
                elif message == b"L":
                    lost.append(content.decode("utf-8", "replace"))
                elif message == b"X":
                    reason = content.decode("utf-8", "replace")
            if reason is None:
                break
            broken += 1
            if broken > _MAX_BROKEN:
                report.notes.append(f"{path.name}: stopped: the rest cannot be decoded ({reason}).")
                break
            lost.append(reason)
            start += 1  # the packet that took the decoder down is passed over
        if lost:
            report.notes.append(f"{path.name}: {len(lost):,} damaged packets were left out ({lost[0]}).")
        if others:
            report.notes.append(f"{path.name} also holds {' and '.join(others)}, which are not read.")

    return decode


def _messages(path: Path, track: int | None, start: int) -> Iterator[tuple[bytes, bytes]]:
    """What the worker says until it ends; a worker that breaks down or hangs counts as an error it reports."""
    words = [sys.executable, "-P", str(_WORKER), str(path), "-" if track is None else str(track), str(start)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0) as worker:
        assert worker.stdout is not None
        try:
            while True:
                head = _read(worker.stdout, _HEAD.size)
                if head is None:
                    yield b"X", b"the decoder broke down"
                    return
                message, length = _HEAD.unpack(head)
                content = _read(worker.stdout, length)
                if content is None:
                    yield b"X", b"the decoder broke down"
                    return
                if message == b"Z":
                    return
                yield message, content
                if message == b"X":
                    return
        finally:
            worker.kill()


def _read(pipe: IO[bytes], length: int) -> bytes | None:
    """The next `length` bytes, or None if they do not come."""
    parts: list[bytes] = []
    while length > 0:
        if not select.select([pipe], [], [], _SILENCE_S)[0]:
            return None
        part = pipe.read(length)
        if not part:
            return None
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def _columns(content: bytes) -> Columns:
    count = len(content) // 13
    t = np.frombuffer(content, "<u8", count)
    x, y = np.frombuffer(content, "<u2", count, 8 * count), np.frombuffer(content, "<u2", count, 10 * count)
    return Columns(_signed(t), x, y, np.frombuffer(content, np.bool_, count, 12 * count))


def _signed(t: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Times beyond 63 bits are no times; they become negative and are refused as running backwards."""
    return t.view(np.int64)


def _add_triggers(content: bytes, report: DecodeReport) -> None:
    """Sources 1 to 3 of AEDAT4 are a rising edge, a falling edge and a pulse on the signal input."""
    count = len(content) // 9
    t, source = np.frombuffer(content, "<u8", count), np.frombuffer(content, np.uint8, count, 8 * count)
    edges = (source >= 1) & (source <= 3)
    report.add_triggers(t[edges], source[edges] != 2, np.zeros(np.count_nonzero(edges)))
