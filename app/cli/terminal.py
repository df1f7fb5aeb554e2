"""What is said on a terminal; the only place of the command line that prints.

Names, notes and messages come from files: no control character of theirs reaches the terminal, which would obey it.
"""

from __future__ import annotations

import io
import logging
import sys
from collections.abc import Iterable
from typing import Final

from core.text import plain

LONGEST_LINE: Final = 2000


def accept_any_text() -> None:
    """Let the terminal, a file or a pipe take any text: what its encoding has no sign for is escaped.

    Names and notes may hold any character; ASCII, Latin-1 and Windows' code pages have few of them.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def say(text: str = "", *, error: bool = False) -> None:
    """A text of our own, of one or several lines, on standard output, or on standard error."""
    print("\n".join(plain(line, None) for line in text.split("\n")), file=sys.stderr if error else None, flush=True)


def print_lines(lines: Iterable[str]) -> None:
    """Lines that may hold text from files: each is one line, whatever is in it."""
    for line in lines:
        say(plain(line, LONGEST_LINE))


class PlainFormatter(logging.Formatter):
    """Log lines without control characters; those of a traceback stay lines."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(plain(line, LONGEST_LINE) for line in super().format(record).split("\n"))
