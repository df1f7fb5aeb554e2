"""Finds the frames of a log, also behind a damaged piece: what is no whole frame is a gap, and the next one follows."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Final

from isal import isal_zlib

from core.recordings.log.growing import HEAD, MAGIC, MARKER, Json
from core.text import parse_json

LARGEST_META: Final = 64 << 20
"""Bytes of a description; one that claims more is damaged."""
_PART: Final = 1 << 20
_SEARCHED_TIMES: Final = 4
"""A search looks at no more bytes than so many times the file, whatever is in it."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One entry of the log; its payload lies at `offset` in the file."""

    meta: dict[str, Json]
    offset: int
    size: int


@dataclass(frozen=True, slots=True)
class LogGap:
    """Bytes from `begin` to before `end` that are no whole frame."""

    begin: int
    end: int
    unfinished: bool
    """It is the beginning of one frame at the end of the file: what a kill leaves, and no damage."""


def scan(file: BinaryIO) -> Iterator[Frame | LogGap]:
    """The frames of the log in order, by their headers alone; a gap to the end where one is no header."""
    log = _Log(file)
    position = len(MAGIC)
    while position < log.end:
        frame = log.frame_at(position, check=False)
        if frame is None:
            yield LogGap(position, log.end, unfinished=False)
            return
        yield frame
        position = frame.offset + frame.size


def scan_damaged(file: BinaryIO) -> Iterator[Frame | LogGap]:
    """The frames of the log in order, each with its checksum compared, and the gaps between them.

    Behind a damaged frame the next one is searched by marker, description and checksum.
    """
    log = _Log(file)
    position = len(MAGIC)
    while position < log.end:
        frame = log.frame_at(position, check=True)
        if frame is None:
            following = log.next_frame(position)
            yield LogGap(position, following, unfinished=following == log.end and log.is_unfinished(position))
            position = following
            continue
        yield frame
        position = frame.offset + frame.size


class _Log:
    """The bytes of a log; what a search may still read of them is counted."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.end = os.fstat(file.fileno()).st_size
        self._left = _SEARCHED_TIMES * self.end

    def frame_at(self, position: int, *, check: bool) -> Frame | None:
        """The frame that begins there, if one does and it is whole."""
        head = self._head(position)
        if head is None:
            return None
        meta_size, size, checksum = head
        payload_at = position + HEAD.size + meta_size
        if meta_size > LARGEST_META or payload_at + size > self.end:
            return None
        text = self._read(position + HEAD.size, meta_size)
        meta = _described(text)
        if meta is None or (check and self._checksum(text, payload_at, size) != checksum):
            return None
        return Frame(meta, payload_at, size)

    def next_frame(self, position: int) -> int:
        """Where the next whole frame behind a damaged one begins; the end of the file if there is none."""
        head = self._head(position)
        if head is not None:  # only the inside is damaged: a frame that lies in its data is no frame
            behind = position + HEAD.size + head[0] + head[1]
            if behind == self.end or (behind < self.end and self.frame_at(behind, check=True)):
                return behind
        at = position + 1
        while at < self.end and self._left > 0:
            part = self._read(at, _PART)
            found = part.find(MARKER)
            while found >= 0 and self._left > 0:
                if self.frame_at(at + found, check=True):
                    return at + found
                found = part.find(MARKER, found + 1)
            at += max(1, len(part) - len(MARKER) + 1)
        return self.end

    def is_unfinished(self, position: int) -> bool:
        """Whether all that is wrong with the frame there is that the file ends too early."""
        head = self._head(position)
        if head is None:
            start = self._read(position, HEAD.size)
            return len(start) < HEAD.size and start[: len(MARKER)] == MARKER[: len(start)]
        meta_size, size, _ = head
        if meta_size > LARGEST_META or position + HEAD.size + meta_size + size <= self.end:
            return False
        text = self._read(position + HEAD.size, meta_size)
        if len(text) < meta_size:
            return text[:1] in (b"", b"{")
        meta = _described(text)
        if meta is None:
            return False
        sizes = meta.get("sizes", [])
        return isinstance(sizes, list) and sum(part for part in sizes if isinstance(part, int)) == size

    def _head(self, position: int) -> tuple[int, int, int] | None:
        data = self._read(position, HEAD.size)
        if len(data) < HEAD.size:
            return None
        marker, meta_size, size, checksum = HEAD.unpack(data)
        return (meta_size, size, checksum) if marker == MARKER else None

    def _checksum(self, text: bytes, payload_at: int, size: int) -> int:
        found = isal_zlib.crc32(text)
        for at in range(payload_at, payload_at + size, _PART):
            found = isal_zlib.crc32(self._read(at, min(_PART, payload_at + size - at)), found)
        return found

    def _read(self, position: int, size: int) -> bytes:
        self._file.seek(position)
        data = self._file.read(size)
        self._left -= len(data)
        return data


def _described(text: bytes) -> dict[str, Json] | None:
    """The description of a frame, if it is one."""
    if not text.startswith(b"{"):
        return None
    try:
        meta = parse_json(text)
    except ValueError:
        return None
    return meta if isinstance(meta, dict) and isinstance(meta.get("kind"), str) else None
