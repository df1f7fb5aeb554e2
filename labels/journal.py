"""The journals in which version 1 kept labels: read, so that they can be taken over, and never written.

A journal is lines of JSON that end with a checksum. A line torn by a kill was never acknowledged.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import LabelError
from labels.records import unpack_line

FORMAT: Final = "rallyscope-labels"
SCHEMA: Final = 1
_CRC: Final = b',"crc":"'


@dataclass(frozen=True, slots=True)
class JournalLines:
    """What a journal holds."""

    whole: tuple[bytes, ...]
    """Every line that is as it was written."""
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
    """Every whole line.

    Raises:
        LabelError: if the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LabelError("cannot read the labels", got=error.strerror, where=path) from error
    whole: list[bytes] = []
    suspects: list[int] = []
    damaged: list[int] = []
    for number, line in enumerate(content.split(b"\n")[:-1], start=1):
        if not is_whole(line):
            suspects.append(number)
            continue
        damaged += suspects  # a good line behind them: they are not a torn end
        suspects.clear()
        whole.append(line)
    return JournalLines(tuple(whole), tuple(damaged))


def is_whole(line: bytes) -> bool:
    """Whether a line without its newline is as it was written."""
    head, mark, tail = line.rpartition(_CRC)
    return bool(mark) and len(tail) == 10 and tail == b'%08x"}' % zlib.crc32(head)
