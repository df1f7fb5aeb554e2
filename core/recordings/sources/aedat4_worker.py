"""Decodes one AEDAT4 file, in a process of its own: `python aedat4_worker.py PATH TRACK|- START`.

faery reads the header and the triggers. A damaged file can make it abort its whole process, and Rust reports to
standard error what it likes. Here that harms nobody. START is the number of the first packet that is wanted. The
answers go to standard output as messages of kind (one byte), length (uint64) and content:
    I  the file: JSON with the "tracks" that hold events, a list of [number, width, height], and what "others" hold
    N  the number of the packet that comes next: uint64
    E  events: t uint64, x uint16, y uint16, on uint8, column by column
    T  triggers: t uint64, source uint8
    L  a packet that cannot be decoded, and is left out: text
    X  an error, which ends the events: text
    Z  the end
This file is run as it is and imports nothing of this project, so that it starts quickly.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

import numpy as np
import pyarrow
from faery import aedat

try:
    import resource
except ImportError:  # Windows: there nothing limits the worker
    resource = None

MEMORY_BYTES = 4 << 30
"""A damaged file may claim any size; what it asks for beyond this ends the worker instead of the machine."""
MAGIC = b"#!AER-DAT4.0\r\n"
COMPRESSED = {b"\x04\x22\x4d\x18": "lz4", b"\x28\xb5\x2f\xfd": "zstd"}
"""How a packet of LZ4 or Zstandard begins."""
EVENT = np.dtype({"names": ["t", "x", "y", "on"], "formats": ["<i8", "<i2", "<i2", "u1"], "itemsize": 16})
"""A time in microseconds, a column, a row, whether brighter, and padding."""
PLAIN = (b"EVTS", b"TRIG", b"FRME", b"IMUS")
"""Kinds of a packet that is not compressed: its kind, after two numbers of 32 bits."""
HEAD = struct.Struct("<ii")
NONE = -1
"""Track of bytes that are no packet."""


class Packet(NamedTuple):
    """Where a packet lies in the file."""

    number: int
    track: int
    start: int
    end: int


def main(path: str, track: int | None, start: int) -> None:
    """Decode one file and send its events over standard output; a failure is sent, too."""
    if resource is not None:
        with suppress(ValueError, OSError):  # macOS may know no such limit
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    try:
        decode(path, track, start)
        send(b"Z")
    except BaseException as error:  # noqa: BLE001 (a panic of Rust is no Exception)
        send(b"X", describe(error))
    os._exit(0)  # decoders that failed may abort when they are taken down


def decode(path: str, track: int | None, start: int) -> None:
    """Send the events of a track, packet by packet; one that cannot be decoded harms no other."""
    try:
        found = aedat.Decoder(path).tracks()
    except BaseException:  # noqa: BLE001 - its header may be whole, and only the table at the end not
        found = read_tracks(path)
    tracks = [item for item in found if item.data_type == "events"]
    sizes = [item.dimensions or (0, 0) for item in tracks]
    listed = [(item.id, size[0], size[1]) for item, size in zip(tracks, sizes, strict=True)]
    others = sorted({item.data_type for item in found if item.data_type not in ("events", "triggers")})
    send(b"I", json.dumps({"tracks": listed, "others": others}).encode())
    wanted = tracks[0].id if track is None and tracks else track
    kinds = {item.id: item.data_type for item in found}
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        header, end = read_header(data)
        for packet in find_packets(data, len(header), end, kinds):
            if packet.number < start:
                continue
            if packet.track == NONE:
                send(b"L", f"{packet.end - packet.start} bytes that are none".encode())
                continue
            is_wanted = packet.track == wanted
            if not is_wanted and kinds[packet.track] != "triggers":
                continue
            send(b"N", struct.pack("<Q", packet.number))
            try:
                if is_wanted:
                    send_events(data[packet.start + HEAD.size : packet.end])
                else:
                    send_triggers(header, data[packet.start : packet.end])
            except BaseException as error:  # noqa: BLE001 - a panic of Rust is no Exception
                send(b"L", describe(error))


def send_events(content: bytes) -> None:
    """Send what a packet of events holds, each with its own time: faery would hold back those that step back.

    The packet is a FlatBuffer behind its size: a table whose first field is a vector of structs.
    """
    for mark, name in COMPRESSED.items():
        if content.startswith(mark):
            content = bytes(pyarrow.input_stream(pyarrow.BufferReader(content), compression=name).read())
    if content[8:12] != b"EVTS":
        raise ValueError("a packet of a stream of events holds none")
    root = 4 + struct.unpack_from("<I", content, 4)[0]
    table = root - struct.unpack_from("<i", content, root)[0]
    fields = struct.unpack_from("<H", content, table)[0] // 2 - 2
    place = struct.unpack_from("<H", content, table + 4)[0] if fields > 0 else 0
    if not place:
        raise ValueError("the packet is empty")
    vector = root + place + struct.unpack_from("<I", content, root + place)[0]
    (count,) = struct.unpack_from("<I", content, vector)
    events = np.frombuffer(content, EVENT, count, vector + 4)
    columns = ((events["t"], "<u8"), (events["x"], "<u2"), (events["y"], "<u2"), (events["on"] != 0, "u1"))
    send(b"E", b"".join(column.astype(dtype).tobytes() for column, dtype in columns))


def send_triggers(header: bytes, packet: bytes) -> None:
    """Send what a packet of triggers holds: it stands alone behind the header in a file of its own."""
    with decoder_of(header + packet) as alone:
        for _, content in alone:
            if not isinstance(content, np.ndarray):
                continue
            send(b"T", content["t"].astype("<u8").tobytes() + content["source"].astype("u1").tobytes())


def read_tracks(path: str) -> list[aedat.Track]:
    """The tracks that the header lists."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        header, _ = read_header(data)
    with decoder_of(header) as alone:
        return alone.tracks()


@contextmanager
def decoder_of(content: bytes) -> Iterator[aedat.Decoder]:
    """Context manager with the decoder of a file of this content.

    The file is closed before faery opens it: Windows opens none twice that was made to vanish when it is closed.
    """
    with tempfile.TemporaryDirectory(prefix="rallyscope-", ignore_cleanup_errors=True) as folder:
        path = os.path.join(folder, "alone.aedat4")
        with open(path, "wb") as file:
            file.write(content)
        yield aedat.Decoder(path)


def read_header(data: mmap.mmap) -> tuple[bytes, int]:
    """The header without the place of the table at the end of the file, and where the packets end."""
    (size,) = struct.unpack_from("<I", data, len(MAGIC))
    header = bytearray(data[: len(MAGIC) + 4 + size])
    base = len(MAGIC) + 4
    end = len(data)
    with suppress(struct.error):
        root = base + struct.unpack_from("<I", header, base)[0]
        table = root - struct.unpack_from("<i", header, root)[0]
        fields = struct.unpack_from("<H", header, table)[0] // 2 - 2
        place = struct.unpack_from("<H", header, table + 6)[0] if fields > 1 else 0
        if place:
            (stated,) = struct.unpack_from("<q", header, root + place)
            end = stated if len(header) < stated <= end else end
            struct.pack_into("<q", header, root + place, -1)
    return bytes(header), end


def find_packets(data: mmap.mmap, start: int, end: int, kinds: dict[int, str]) -> Iterator[Packet]:
    """Every packet of the file up to the stated `end`; behind bytes that are none, the next that begins as one."""
    number, at, stated, end = 0, start, end, len(data)
    while at + HEAD.size <= end and at != stated:
        track, size = HEAD.unpack_from(data, at)
        after = at + HEAD.size + size
        is_packet = is_head(data, at, end, kinds)
        whole = is_packet and (after in (stated, end) or is_head(data, after, end, kinds))
        if whole or (is_packet and begins_as_packet(data, at)):
            yield Packet(number, track, at, after)
            # bytes of a packet may be lost: then the next one begins earlier
            at = after if whole else min(after, next_packet(data, at + HEAD.size, end, kinds))
        else:
            after = next_packet(data, at + 1, end, kinds)
            yield Packet(number, NONE, at, after)
            at = after
        number += 1
    if at < end and at != stated:
        yield Packet(number, NONE, at, end)


def is_head(data: mmap.mmap, at: int, end: int, kinds: dict[int, str]) -> bool:
    """Whether a known track and a size that fits stand here."""
    if at + HEAD.size > end:
        return False
    track, size = HEAD.unpack_from(data, at)
    return track in kinds and 0 < size <= end - at - HEAD.size


def begins_as_packet(data: mmap.mmap, at: int) -> bool:
    """Whether the content behind the head at `at` begins as packets do."""
    content = data[at + HEAD.size : at + HEAD.size + 12]
    return content.startswith(tuple(COMPRESSED)) or content[8:12] in PLAIN


def next_packet(data: mmap.mmap, at: int, end: int, kinds: dict[int, str]) -> int:
    """Where the next packet from `at` on begins; `end` if there is none."""
    marks = [(mark, HEAD.size) for mark in COMPRESSED] + [(mark, HEAD.size + 8) for mark in PLAIN]
    found = []
    for mark, before in marks:
        place = data.find(mark, at + before, end)
        while place >= 0 and not is_head(data, place - before, end, kinds):
            place = data.find(mark, place + 1, end)
        if place >= 0:
            found.append(place - before)
    return min(found, default=end)


def describe(error: BaseException) -> bytes:
    """What an error says, in one line."""
    return " ".join(str(error).split()).encode()


def send(kind: bytes, content: bytes = b"") -> None:
    """Write one message."""
    sys.stdout.buffer.write(struct.pack("<cQ", kind, len(content)) + content)
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main(sys.argv[1], None if sys.argv[2] == "-" else int(sys.argv[2]), int(sys.argv[3]))
