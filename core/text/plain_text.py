"""Text from a file, made fit to be shown: no control characters, no reversed reading, no end that never comes."""

from __future__ import annotations

import re
from typing import Final

LONGEST: Final = 300
_UNFIT: Final = re.compile(
    "[\x00-\x1f\x7f-\x9f"  # controls: ESC moves a terminal's cursor, CR and backspace write over what was said
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"  # directions: what is read is not what is there
    "\u2028\u2029\ufeff\ud800-\udfff]"  # other line breaks, and halves of characters, which no encoding takes
)
_KNOWN: Final = {"\n": "\\n", "\r": "\\r", "\t": "\\t"}


def plain(text: str, most: int | None = LONGEST) -> str:
    """The text on one line, with a visible escape for what is unfit to be shown; at most `most` characters of it."""
    cut = most is not None and len(text) > most
    return _UNFIT.sub(_escape, text[:most] if cut else text) + (" ..." if cut else "")


def encodable(text: str) -> str:
    """The text with an escape for what no encoding takes: bytes of a file's name that are no characters."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _escape(found: re.Match[str]) -> str:
    mark = found.group()
    return _KNOWN.get(mark) or (f"\\x{ord(mark):02x}" if ord(mark) < 0x100 else f"\\u{ord(mark):04x}")
