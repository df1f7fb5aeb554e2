"""The file a recording lives in while it is written: frames appended to a log, each with its own checksum.

An HDF5 file whose writer is killed is lost whole. So a recording grows as a log under its final name, and becomes HDF5
when it is closed (`assemble`). A kill can only cut the last frame short; everything before it is found again by `scan`.

    file   = MAGIC, frame, frame, ...
    frame  = marker, length of meta, length of payload, CRC-32 of both, meta (JSON with a "kind"), payload
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from isal import isal_zlib

from core.errors import RecordingError
from core.files import lock_descriptor
from core.text.json_text import parse_json

MAGIC: Final = b"RALLYSCOPE-GROW1"
_HEAD: Final = struct.Struct("<4sIQI")
_MARKER: Final = b"FRM1"

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


@dataclass(frozen=True, slots=True)
class Frame:
    """One entry of the log; its payload lies at `offset` in the file."""

    meta: dict[str, Json]
    offset: int
    size: int


class GrowingFile:
    """The writing end of the log. It holds a lock, so that nobody takes a file that still grows for a dead one."""

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        try:
            if overwrite and path.exists():
                _make_way(path)
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError as error:
            raise RecordingError("the file exists", where=path, remedy="choose another name, or --force") from error
        except OSError as error:
            raise RecordingError("cannot create the recording", got=error.strerror, where=path) from error
        self.path = path
        try:
            _lock(self._descriptor, path)
            self._end = 0
            self._write([MAGIC])
        except BaseException:
            os.close(self._descriptor)
            raise

    def append(self, meta: Mapping[str, Json], payload: list[bytes] | None = None) -> None:
        """Hand one frame to the operating system: from then on a kill of this process does not lose it.

        Raises:
            RecordingError: if the disk is full or fails; all earlier frames are kept.
        """
        text = json.dumps(meta, separators=(",", ":")).encode()
        parts = payload or []
        checksum = isal_zlib.crc32(text)
        for part in parts:
            checksum = isal_zlib.crc32(part, checksum)
        size = sum(len(part) for part in parts)
        self._write([_HEAD.pack(_MARKER, len(text), size, checksum), text, *parts])

    @property
    def closed(self) -> bool:
        return self._descriptor < 0

    def sync(self) -> None:
        """Return when everything is on the disk itself and outlives a power cut too."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Let go of the file as it is."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _write(self, parts: list[bytes]) -> None:
        data = memoryview(b"".join(parts))
        done = 0
        try:
            while done < len(data):
                done += os.pwrite(self._descriptor, data[done:], self._end + done)
        except OSError as error:
            raise RecordingError(
                "the recording could not be written to disk",
                got=error.strerror,
                where=self.path,
                remedy="free some space; what was written before is kept and opens",
            ) from error
        self._end += len(data)


def is_growing(path: Path) -> bool:
    """Whether the file is such a log."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def open_abandoned(path: Path) -> BinaryIO:
    """The log of a writer that is gone, open for reading and locked.

    Raises:
        RecordingError: if its writer is still at work.
    """
    file = path.open("rb")
    try:
        _lock(file.fileno(), path, shared=True)
    except BaseException:
        file.close()
        raise
    return file


def scan(file: BinaryIO, *, check: bool) -> Iterator[Frame]:
    """The frames of the log in order, ending silently at the first one that is not whole.

    With `check` each payload is read and its checksum compared; without, only the headers are read.
    """
    end = os.fstat(file.fileno()).st_size
    position = len(MAGIC)
    while position + _HEAD.size <= end:
        file.seek(position)
        marker, meta_size, size, checksum = _HEAD.unpack(file.read(_HEAD.size))
        payload_at = position + _HEAD.size + meta_size
        if marker != _MARKER or payload_at + size > end:
            return
        text = file.read(meta_size)
        if check and not _is_intact(file, text, size, checksum):
            return
        yield Frame(parse_json(text), payload_at, size)
        position = payload_at + size


def _is_intact(file: BinaryIO, text: bytes, size: int, checksum: int) -> bool:
    found = isal_zlib.crc32(text)
    while size > 0:
        part = file.read(min(size, 1 << 20))
        found = isal_zlib.crc32(part, found)
        size -= len(part)
    return found == checksum


def _make_way(path: Path) -> None:
    """Remove an older recording. Whoever reads it keeps what they have open; nobody may still be writing it."""
    if is_growing(path):
        open_abandoned(path).close()
    path.unlink()


def _lock(descriptor: int, path: Path, *, shared: bool = False) -> None:
    try:
        lock_descriptor(descriptor, shared=shared)
    except OSError as error:
        raise RecordingError("the recording is being written right now", where=path, remedy="wait for it") from error
