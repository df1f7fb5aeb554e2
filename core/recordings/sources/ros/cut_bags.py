"""Bags of ROS that lost their end: a .bag without its index, a .db3 whose last pages are missing; record after record.

The libraries begin at the index, which stands at the end of a .bag, and SQLite refuses a file that is shorter than it
says. What is whole is read here. Sources: wiki.ros.org/Bags/Format/2.0; SQLite's `lockBtree`.
"""

from __future__ import annotations

import bz2
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple
from urllib.parse import quote

_START: Final = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
_LARGEST_RECORD: Final = 1 << 30


class CutMessage(NamedTuple):
    """A message, or with `data` None only the topic, which stands in front of its messages."""

    topic: str
    type: str
    """As ROS 2 spells it."""
    definition: str
    time_ns: int = 0
    data: bytes | None = None


def scan_ros1(path: Path) -> Iterator[CutMessage]:
    """Topics and messages of a .bag in the order of the file, up to the first record that is not whole."""
    known: dict[int, CutMessage] = {}
    with path.open("rb") as file:
        if file.read(len(_START)) != _START:
            return
        yield from _scan(file, known)


def _scan(file: BinaryIO, known: dict[int, CutMessage]) -> Iterator[CutMessage]:
    while (record := _read_record(file)) is not None:
        header, data, whole = record
        kind = header.get("op", b"\0")[0]
        if not whole and (kind != _CHUNK or header.get("compression") != b"none"):
            return
        if kind == _CHUNK:
            unpacked = _unpacked(data, header.get("compression", b""))
            if unpacked is None:
                return
            yield from _scan(BytesIO(unpacked), known)
        elif kind == _CONNECTION:
            inner = _fields(data)
            words = {name: inner.get(name, b"").decode("utf-8", "replace") for name in ("type", "message_definition")}
            kind_of = words["type"].replace("/", "/msg/") if words["type"].count("/") == 1 else words["type"]
            topic = header.get("topic", b"").decode("utf-8", "replace")
            number = _number(header["conn"])
            if number not in known:
                known[number] = CutMessage(topic, kind_of, words["message_definition"])
                yield known[number]
        elif kind == _MESSAGE and (one := known.get(_number(header["conn"]))) is not None:
            seconds, nanoseconds = struct.unpack("<II", header["time"])
            yield one._replace(time_ns=seconds * 1_000_000_000 + nanoseconds, data=data)


def _read_record(file: BinaryIO) -> tuple[dict[str, bytes], bytes, bool] | None:
    """Header and data of the next record, and whether the data is all there; None at the end."""
    header, whole = _read_part(file)
    if not whole:
        return None
    data, whole = _read_part(file)
    return _fields(header), data, whole


def _read_part(file: BinaryIO) -> tuple[bytes, bool]:
    length = file.read(4)
    size = _number(length) if len(length) == 4 else _LARGEST_RECORD
    part = file.read(size) if size < _LARGEST_RECORD else b""
    return part, len(part) == size


def _fields(header: bytes) -> dict[str, bytes]:
    """`name=value` pairs, each behind its length."""
    found: dict[str, bytes] = {}
    at = 0
    while at + 4 <= len(header):
        size = _number(header[at : at + 4])
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        found[name.decode("latin-1")] = value
        at += 4 + size
    return found


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _unpacked(data: bytes, compression: bytes) -> bytes | None:
    try:
        if compression == b"bz2":
            return bz2.decompress(data)
        if compression == b"lz4":
            from lz4.frame import decompress

            return bytes(decompress(data))
    except (OSError, ValueError, RuntimeError):
        return None
    return data


def is_cut_db3(path: Path) -> bool:
    """Whether a .db3 has fewer pages than its header says."""
    with path.open("rb") as file:
        head = file.read(32)
    page_bytes = int.from_bytes(head[16:18], "big")
    pages = int.from_bytes(head[28:32], "big")
    return pages * (65536 if page_bytes == 1 else page_bytes) > path.stat().st_size


def scan_db3(path: Path) -> Iterator[CutMessage]:
    """Topics and messages of a .db3 in the order in which they were written, up to the first page that is missing."""
    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    with closing(sqlite3.connect(address, uri=True)) as db:
        db.execute("PRAGMA trusted_schema = OFF")
        db.execute("PRAGMA cell_size_check = ON")
        # Otherwise SQLite compares the size of the file with that in its header first, and reads nothing.
        db.execute("PRAGMA writable_schema = ON")
        definitions: dict[str, str] = {}
        with suppress(sqlite3.Error):  # an older rosbag2 writes none
            rows = db.execute("SELECT topic_type, encoded_message_definition FROM message_definitions")
            definitions = {str(kind): str(text) for kind, text in rows}
        known: dict[int, CutMessage] = {}
        for number, name, kind in db.execute("SELECT id, name, type FROM topics"):
            known[number] = CutMessage(str(name), str(kind), definitions.get(str(kind), ""))
            yield known[number]
        for number, time_ns, data in db.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY rowid"):
            # The page that was cut holds zeros where its rows are: they have no topic.
            if number in known and isinstance(data, bytes):
                yield known[number]._replace(time_ns=int(time_ns), data=data)
