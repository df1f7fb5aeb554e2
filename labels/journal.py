"""An append-only file of lines of which none is lost once `append` has returned, whatever kills the process.

Nothing is ever rewritten in place. A write that fails is cut off again, so that the file always ends with a whole line;
a line torn by a kill was never acknowledged and is cut off when the file is opened for writing the next time.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from core.errors import LabelError
from core.files import lock_descriptor, sync
from labels.records import Json, is_whole, pack_line, unpack_line


@dataclass(frozen=True, slots=True)
class JournalLines:
    """What a journal holds."""

    whole: tuple[bytes, ...]
    """Every line that is as it was written; as bytes, because 200,000 parsed ones at a time are slow to keep."""
    whole_bytes: int
    """Everything behind this is a torn end."""
    damaged: tuple[int, ...]
    """Numbers (from 1) of damaged lines with good ones behind them: bit rot or a foreign editor, never a kill."""

    @property
    def records(self) -> Iterator[dict[str, object]]:
        """What the lines say, one after the other.

        Raises:
            LabelError: at a line that no version of this program has written.
        """
        return map(unpack_line, self.whole)


def read_journal(path: Path) -> JournalLines:
    """Every whole line; a missing file is an empty journal.

    Raises:
        LabelError: if the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        content = b""
    except OSError as error:
        raise LabelError("cannot read the labels", got=error.strerror, where=path) from error
    whole: list[bytes] = []
    suspects: list[int] = []
    damaged: list[int] = []
    whole_bytes = 0
    for number, (line, end) in enumerate(_lines(content), start=1):
        if not is_whole(line):
            suspects.append(number)
            continue
        damaged += suspects  # a good line behind them: they are not a torn end
        suspects.clear()
        whole.append(line)
        whole_bytes = end
    return JournalLines(tuple(whole), whole_bytes, tuple(damaged))


class Journal:
    """A journal that is open for writing, by this process only. Not safe for threads: its owner holds a lock."""

    def __init__(self, path: Path, file: int, size: int) -> None:
        self.path = path
        self._file = file
        self._size = size

    @classmethod
    def open(cls, path: Path) -> tuple[Self, JournalLines]:
        """Open or start a journal, cut off a torn end, and read what it holds.

        Raises:
            LabelError: if the folder or file cannot be written, or another process writes it.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise LabelError(
                "cannot write labels here",
                got=error.strerror,
                where=path,
                remedy="choose a folder on a writable disk with --data",
            ) from error
        try:
            lock_descriptor(file)
            lines = read_journal(path)
            if os.fstat(file).st_size != lines.whole_bytes:
                os.ftruncate(file, lines.whole_bytes)
            os.fsync(file)
            sync(path.parent)  # a new file survives a power cut only with its folder's entry
        except BlockingIOError as error:
            os.close(file)
            raise LabelError(
                "another program is writing these labels", where=path, remedy="close it, or label under another name"
            ) from error
        except OSError as error:
            os.close(file)
            raise LabelError("cannot write labels here", got=error.strerror, where=path) from error
        except LabelError:
            os.close(file)
            raise
        return cls(path, file, lines.whole_bytes), lines

    def append(self, record: Json) -> None:
        """Write one line and wait until it is on the disk.

        Raises:
            LabelError: if that fails; the journal is then as it was before, and the next call tries again.
        """
        line = pack_line(record)
        try:
            if os.fstat(self._file).st_size != self._size:  # what an earlier failed write has left
                os.ftruncate(self._file, self._size)
            done = 0
            while done < len(line):
                done += os.pwrite(self._file, line[done:], self._size + done)
            os.fdatasync(self._file)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self._size)
            raise LabelError(
                "this label is not saved",
                got=error.strerror,
                where=self.path,
                remedy="everything before it is safe; make room or fix the disk, then repeat it",
            ) from error
        self._size += len(line)

    def close(self) -> None:
        """Let go of the file; every line is on the disk already."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _lines(content: bytes) -> Iterator[tuple[bytes, int]]:
    """Lines that end with a newline, and where each ends."""
    start = 0
    while (end := content.find(b"\n", start)) >= 0:
        yield content[start:end], end + 1
        start = end + 1
