"""The file a recording lives in while it is written: frames appended to a log, each with its own checksum.

An HDF5 file whose writer is killed is lost whole. So a recording grows as a log under its final name, and becomes HDF5
when it is closed (`assemble`). A kill can only cut the last frame short; a failing disk may damage any. All others are
found again by `scanning`, which knows a frame by its marker and its checksum.

    file   = MAGIC, frame, frame, ...
    frame  = marker, length of meta, length of payload, CRC-32 of both, meta (JSON with a "kind"), payload
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final

from isal import isal_zlib

from core.errors import RecordingError
from core.files import BINARY, POSIX, lock_descriptor, sync, write_at

MAGIC: Final = b"RALLYSCOPE-GROW1"
HEAD: Final = struct.Struct("<4sIQI")
MARKER: Final = b"FRM1"

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


class GrowingFile:
    """The writing end of the log. It holds a lock, so that nobody takes a file that still grows for a dead one."""

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        try:
            if overwrite and path.exists():
                _make_way(path)
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | BINARY, 0o666)
        except FileExistsError as error:
            raise RecordingError("the file exists", where=path, remedy="choose another name, or --force") from error
        except OSError as error:
            raise RecordingError("cannot create the recording", got=error.strerror, where=path) from error
        self.path = path
        self._named = False
        try:
            _lock(self._descriptor, path)
            self._end = 0
            self._write([MAGIC])
        except BaseException:
            os.close(self._descriptor)
            with suppress(OSError):
                path.unlink()
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
        self._write([HEAD.pack(MARKER, len(text), size, checksum), text, *parts])

    @property
    def closed(self) -> bool:
        return self._descriptor < 0

    def sync(self) -> None:
        """Return when everything, and the file's name, is on the disk itself and outlives a power cut too.

        Raises:
            RecordingError: if the disk fails.
        """
        try:
            os.fsync(self._descriptor)
            if not self._named:
                sync(self.path.parent)
                self._named = True
        except OSError as error:
            raise _disk_refuses(self.path, error) from error

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
                done += write_at(self._descriptor, data[done:], self._end + done)
        except OSError as error:
            raise _disk_refuses(self.path, error) from error
        self._end += len(data)


def is_growing(path: Path) -> bool:
    """Whether the file is such a log.

    Raises:
        RecordingError: on Windows, if its writer is at work: there nobody else may read what it has locked.
    """
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except PermissionError as error:
        if POSIX:
            raise
        raise _being_written(path) from error


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


def _disk_refuses(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        "the recording could not be written to disk",
        got=error.strerror,
        where=path,
        remedy="free some space; what was written before is kept and opens",
    )


def _make_way(path: Path) -> None:
    """Remove an older recording. Whoever reads it keeps what they have open; nobody may still be writing it."""
    if is_growing(path):
        open_abandoned(path).close()
    path.unlink()


def _lock(descriptor: int, path: Path, *, shared: bool = False) -> None:
    try:
        lock_descriptor(descriptor, shared=shared)
    except OSError as error:
        raise _being_written(path) from error


def _being_written(path: Path) -> RecordingError:
    return RecordingError("the recording is being written right now", where=path, remedy="wait for it")
