"""Text: decoded where its encoding is not known, made fit to be shown, read as JSON or TOML within bounds, written as
tables of pages, and hosts in addresses.
"""

from __future__ import annotations

import codecs
import ipaddress
import json
import re
import tomllib
from collections.abc import Iterable, Sequence
from typing import Any, Final


def is_loopback(host: str) -> bool:
    """Whether a host, with or without the brackets of IPv6, is this machine alone; of all names only localhost is."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.removeprefix("[").removesuffix("]")).is_loopback
    except ValueError:
        return False


_BYTE_ORDER_MARKS: Final = (
    (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"),
)  # fmt: skip
_NO_TEXT: Final = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_HEAD_BYTES: Final = 64


_COMPRESSED: Final = (
    (b"\x1f\x8b", "gzip"), (b"\x1f\x9d", "compress"), (b"BZh", "bzip2"), (b"\xfd7zXZ", "xz"),
    (b"\x28\xb5\x2f\xfd", "Zstandard"), (b"\x04\x22\x4d\x18", "LZ4"), (b"Rar!", "RAR"),
    (b"7z\xbc\xaf\x27\x1c", "7-Zip"),
    (b"PK\x03\x04", "ZIP"), (b"PK\x05\x06", "ZIP"),
)  # fmt: skip


def compression_of(head: bytes) -> str | None:
    """What a file was compressed with, by its first bytes; None if it was not."""
    if head[257:262] == b"ustar":
        return "tar"
    return next((name for start, name in _COMPRESSED if head.startswith(start)), None)


def encoding_of(content: bytes, *, whole: bool = True) -> str:
    """Name of the encoding of a text: UTF-16 and UTF-32 by their marks or zero bytes, UTF-8 where it can be that, else
    Latin-1. Where more bytes follow (not `whole`), the last character may be cut.
    """
    marked = next((name for mark, name in _BYTE_ORDER_MARKS if content.startswith(mark)), None)
    if marked is not None:
        return marked
    even, odd = content[0:_HEAD_BYTES:2], content[1:_HEAD_BYTES:2]
    for name, high, low in (("utf-16-le", odd, even), ("utf-16-be", even, odd)):
        if 4 * high.count(0) > 3 * len(high) and 0 not in low:
            return name
    try:
        codecs.getincrementaldecoder("utf-8")().decode(content, final=whole)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def decode_text(content: bytes) -> str:
    """The text of a file in any encoding that `encoding_of` knows, without its byte-order mark.

    Raises:
        UnicodeDecodeError: if it is no text: not UTF-8, and with control characters.
    """
    encoding = encoding_of(content)
    control = _NO_TEXT.search(content) if encoding == "latin-1" else None
    if control is not None:
        raise UnicodeDecodeError("utf-8", content, control.start(), control.end(), "not UTF-8, and no other text")
    return content.decode(encoding, "replace")


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: if it is none, or nested more deeply than a parser can go.
    """
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def markdown_table(titles: Sequence[str], rows: Iterable[Sequence[object]], formats: Sequence[str] = ()) -> str:
    """Rows as a Markdown table that ends with a line break.

    A cell is text or a number, which is written as its column's format asks (",", ".3f"; none for "" and for columns
    beyond the last one); None is "-". Columns with a format are aligned to the right.
    """
    asked = [*formats, *[""] * (len(titles) - len(formats))]
    marks = ["---:" if form else "---" for form in asked]
    cells = (
        ["-" if value is None else value if isinstance(value, str) else format(value, form) for value, form in pairs]
        for pairs in (zip(row, asked, strict=True) for row in rows)
    )
    return "".join(f"| {' | '.join(line)} |\n" for line in (titles, marks, *cells))


def counted(count: int, thing: str) -> str:
    """A number of things, as "1 label" or "1,260 events"; `thing` is the singular of what takes s or es."""
    plural = f"{thing}es" if thing.endswith(("s", "x", "ch")) else f"{thing}s"
    return f"{count:,} {thing if count == 1 else plural}"


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


MAX_CHARACTERS: Final = 1 << 20
"""A config or a calibration is a few kilobytes."""
MAX_DOTS: Final = 64
"""In one key: for a key of 50,000 parts the parser needs a minute."""


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: if it is none, too long, or nested more deeply than a parser can go.
    """
    text = text.removeprefix("\ufeff")  # editors of Windows put a byte-order mark before a text
    if len(text) > MAX_CHARACTERS:
        raise ValueError("too long")
    if any(part.count(".") > MAX_DOTS for part in re.split(r"[=,{}\[\]\n]", text)):
        raise ValueError("a key with too many parts")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
