"""What is printed on a terminal, rows of figures too; the only place of the command line that prints.

Names, notes and messages come from files: no control character of theirs reaches the terminal, which would obey it.
"""

from __future__ import annotations

import io
import logging
import math
import os
import sys
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Final, TextIO

from core.text import plain

LONGEST_LINE: Final = 2000


_lost: list[str] = []
"""Standard streams that could not be written to."""


def prepare_streams() -> None:
    """Let the terminal, a file or a pipe take any text: what its encoding has no sign for is escaped.

    Names and notes may hold any character; ASCII, Latin-1 and Windows' code pages have few of them. A stream that is
    missing leads nowhere, as `2> /dev/null` does.
    """
    _lost.clear()
    for name in ("stdin", "stdout", "stderr"):
        # Python has None for a stream that the caller closed (`2>&-`), and on Windows without a console. The number
        # of a closed one must not go to the next file that is opened: libraries write to 1 and 2.
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def output_was_lost() -> bool:
    """Whether something that was to be said on standard output could not be written."""
    return "stdout" in _lost


def say(text: str = "", *, error: bool = False) -> None:
    """A text of our own, of one or several lines, on standard output, or on standard error.

    Work does not end because nobody can be told of it: on a full disk the text is lost, which standard error says once.

    Raises:
        BrokenPipeError: if who reads standard output has seen enough.
    """
    stream = sys.stderr if error else sys.stdout
    try:
        print("\n".join(plain(line, None) for line in text.split("\n")), file=stream, flush=True)
    except BrokenPipeError:
        if not error:
            raise
        _lose(stream, "stderr")
    except OSError as failure:
        _lose(stream, "stderr" if error else "stdout")
        if not error:
            say(f"rallyscope: standard output cannot be written: {failure.strerror}; what it says is lost", error=True)


def _lose(stream: TextIO, name: str) -> None:
    """Let a stream lead nowhere: what is left in its buffer would fail again at the end, and change the exit code."""
    _lost.append(name)
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def print_lines(lines: Iterable[str]) -> None:
    """Lines that may hold text from files: each is one line, whatever is in it."""
    for line in lines:
        say(plain(line, LONGEST_LINE))


class PlainFormatter(logging.Formatter):
    """Log lines without control characters; those of a traceback stay lines."""

    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(plain(line, LONGEST_LINE) for line in super().format(record).split("\n"))


def format_table(rows: list[dict[str, object]]) -> str:
    """Rows with the same keys as text, numbers to the right and to three decimals."""
    if not rows:
        return "nothing was measured"
    cells = [list(rows[0]), *([_cell(row.get(title)) for title in rows[0]] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)) for line in cells)


def format_row(row: Mapping[str, object]) -> str:
    """A row on its own, in one line with its titles."""
    return ", ".join(f"{title} {_cell(value)}" for title, value in row.items())


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else plain(str(value))


def json_ready(value: object) -> object:
    """A copy of the value with None for every number that is not finite, which JSON cannot hold."""
    if isinstance(value, dict):
        return {key: json_ready(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_ready(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def silence_viser() -> None:
    """No banner where it listens, no line when it stops, no news of a browser that closed with a picture on its way.

    viser 1.1 has no switch for its banner and its last line; both go through rich, which nothing else here uses.
    """
    import rich

    rich.get_console().quiet = True
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection", category=UserWarning)
