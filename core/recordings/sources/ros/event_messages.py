"""The events in messages of ROS: arrays of event records, and packets of encoded events.

dvs_msgs/EventArray, prophesee_event_msgs/EventArray     records of x, y, ts, polarity, as the bag defines them
event_camera_msgs/EventPacket                            evt3, evt2, evt21; mono and libcaer, 64 bits an event
Sources: the definitions of these messages; for mono the README of event_camera_msgs, for libcaer libcaer's polarity.h.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.recordings.sources.ros.bags import Topic
from core.recordings.sources.source import Columns
from core.text import compression_of

ARRAY_TYPES: Final = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray")
PACKET_TYPES: Final = ("event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray")
"""The second is what the first was called at its beginning."""
RAW_ENCODINGS: Final = {"evt2": "EVT2", "evt21": "EVT21", "evt3": "EVT3"}
"""Packets of these hold the words of a Prophesee RAW file."""
RECORD_ENCODINGS: Final = ("mono", "libcaer")
_SIZES: Final = {"uint8": 1, "int8": 1, "bool": 1, "byte": 1, "uint16": 2, "int16": 2, "uint32": 4, "int32": 4}
_SIZES_64: Final = {"uint64": 8, "int64": 8, "float64": 8, "float32": 4}
_DEFAULT_RECORD: Final = (("x", "uint16"), ("y", "uint16"), ("ts", "time"), ("polarity", "bool"))


@dataclass(frozen=True, slots=True)
class EventArrayMessage:
    """What one message holds."""

    stamp_ns: int
    """Time stamp of its header."""
    frame_id: str
    width_px: int
    height_px: int
    columns: Columns
    """Times in us since 1970, or on the clock of the camera."""


@dataclass(frozen=True, slots=True)
class EventPacketMessage:
    """The fields of an EventPacket."""

    stamp_ns: int
    frame_id: str
    width_px: int
    height_px: int
    seq: int
    time_base_ns: int
    encoding: str
    data: memoryview


class _Cursor:
    """Reads the plain fields of a message one after the other, in either serialisation."""

    def __init__(self, data: bytes, ros1: bool) -> None:
        self.data, self.ros1 = memoryview(data), ros1
        self.start = 0 if ros1 else 4
        """Offset of the fields: CDR has four bytes in front of them, and counts its alignment from there."""
        self.at = self.start
        self.order = "<" if ros1 or (len(data) > 1 and data[1] & 1) else ">"

    def number(self, kind: str) -> int:
        size = struct.calcsize(kind)
        if not self.ros1:
            self.at += -(self.at - self.start) % size
        value = struct.unpack_from(self.order + kind, self.data, self.at)[0]
        self.at += size
        return value

    def text(self) -> str:
        length = self.number("I")
        value = bytes(self.data[self.at : self.at + length]).rstrip(b"\x00").decode("utf-8", "replace")
        self.at += length
        return value

    def header(self) -> tuple[int, str]:
        """Stamp in ns and frame id."""
        if self.ros1:
            self.number("I")
        seconds, nanoseconds = self.number("I"), self.number("I")
        return seconds * 1_000_000_000 + nanoseconds, self.text()


def _refuse_compressed(data: bytes, topic: Topic) -> None:
    """Only the metadata of a ROS 2 bag say that each of its messages is compressed."""
    if not topic.ros1 and compression_of(data[:512]) == "Zstandard":
        raise RecordingError("compressed messages", where=topic.name, remedy="give the folder with metadata.yaml")


def read_event_array(data: bytes, topic: Topic) -> EventArrayMessage:
    """The events of a message of one of `ARRAY_TYPES`.

    Raises:
        RecordingError: if the bag defines its records in a way that is not understood, or the message is damaged.
    """
    _refuse_compressed(data, topic)
    try:
        cursor = _Cursor(data, topic.ros1)
        stamp_ns, frame_id = cursor.header()
        height, width, count = cursor.number("I"), cursor.number("I"), cursor.number("I")
        records = _records(cursor, _record_fields(topic), count, topic.name)
    except (struct.error, ValueError) as error:
        raise RecordingError("a damaged message of events", got=error, where=topic.name) from error
    t_us = records["sec"].astype(np.int64) * 1_000_000 + records["nsec"].astype(np.int64) // 1000
    columns = Columns(t_us, records["x"], records["y"], records["polarity"] != 0)
    return EventArrayMessage(stamp_ns, frame_id, width, height, columns)


def read_event_packet(data: bytes, topic: Topic) -> EventPacketMessage:
    """The fields of a message of one of `PACKET_TYPES`.

    Raises:
        RecordingError: if the message is damaged.
    """
    _refuse_compressed(data, topic)
    try:
        cursor = _Cursor(data, topic.ros1)
        stamp_ns, frame_id = cursor.header()
        height, width, seq, time_base = (cursor.number(kind) for kind in "IIQQ")
        encoding = cursor.text()
        big_endian = cursor.number("B")
        length = cursor.number("I")
        content = cursor.data[cursor.at : cursor.at + length]
        if big_endian or len(content) != length:
            raise ValueError("big-endian events" if big_endian else f"{len(content)} of {length} bytes")
    except (struct.error, ValueError) as error:
        raise RecordingError("a damaged packet of events", got=error, where=topic.name) from error
    return EventPacketMessage(stamp_ns, frame_id, width, height, seq, time_base, encoding, content)


def decode_records(packet: EventPacketMessage) -> Columns:
    """The events of a packet in one of `RECORD_ENCODINGS`; times in us on the clock of its time base."""
    data = packet.data[: len(packet.data) - len(packet.data) % 8]
    if packet.encoding == "mono":
        words = np.frombuffer(data, "<u8")
        t_ns = packet.time_base_ns + (words & np.uint64(0xFFFFFFFF)).astype(np.int64)
        x, y = (words >> np.uint64(32)) & np.uint64(0xFFFF), (words >> np.uint64(48)) & np.uint64(0x7FFF)
        return Columns(t_ns // 1000, x.astype(np.int64), y.astype(np.int64), (words >> np.uint64(63)) != 0)
    pairs = np.frombuffer(data, [("data", "<u4"), ("t", "<i4")])
    t_us, place = pairs["t"].astype(np.int64), pairs["data"]
    wraps = np.concatenate([[0], np.cumsum(np.diff(t_us) < -(2**30))]).astype(np.int64)[: len(t_us)]
    t_us = packet.time_base_ns // 1000 + t_us + (wraps << 31)
    return Columns(t_us, (place >> 17) & 0x7FFF, (place >> 2) & 0x7FFF, (place >> 1) & 1 == 1)


@lru_cache(maxsize=64)
def _record_fields(topic: Topic) -> tuple[tuple[str, str], ...]:
    """Names and types of the fields of one event record, as the bag defines them."""
    if not topic.definition:
        return _DEFAULT_RECORD
    from rosbags.typesys import get_types_from_msg

    package = topic.type.split("/", 1)[0]
    types = get_types_from_msg(topic.definition, topic.type)
    record = types.get(f"{package}/msg/Event")
    if record is None:
        raise RecordingError("the bag does not define the records of its events", got=topic.type, where=topic.name)
    fields: list[tuple[str, str]] = []
    for name, (node, inner) in record[1]:
        kind = "time" if str(inner).endswith("/Time") else str(inner[0]) if node.name == "BASE" else ""
        if kind != "time" and kind not in _SIZES and kind not in _SIZES_64:
            got = f"{name}: {inner}"
            raise RecordingError("a field of the events is not understood", got=got, where=topic.name)
        fields.append((name, kind))
    if not {("ts", "time"), ("x", "uint16"), ("y", "uint16")} <= set(fields) or "polarity" not in dict(fields):
        got = ", ".join(f"{kind} {name}" for name, kind in fields)
        expected = "uint16 x, uint16 y, time ts, bool polarity"
        raise RecordingError("the events have other fields", expected=expected, got=got, where=topic.name)
    return tuple(fields)


def _records(cursor: _Cursor, fields: tuple[tuple[str, str], ...], count: int, where: str) -> NDArray:
    """All event records of a message: packed in ROS 1; in CDR each number lies on a multiple of its size.

    There the first record may lie otherwise than the rest, which repeat from the second on.
    """
    layouts = [_offsets(fields, cursor.ros1, start) for start in _starts(fields, cursor, 4)]
    step = layouts[2]["x"] - layouts[1]["x"]
    if layouts[3]["x"] - layouts[2]["x"] != step:
        raise ValueError("records whose places do not repeat")
    last = layouts[0] if count == 1 else {name: at + (count - 2) * step for name, at in layouts[1].items()}
    end = cursor.start + max((at + _size_of(name, fields) for name, at in last.items()), default=0)
    if count and end > len(cursor.data):
        raise ValueError(f"{count:,} events announced, {len(cursor.data):,} bytes there")
    names, formats = _columns(fields, cursor.order)
    records = np.empty(count, list(zip(names, formats, strict=True)))
    if count:
        buffer = bytes(cursor.data) + bytes(step)  # the last record may lack the padding behind it
        for name, form in zip(names, formats, strict=True):
            records[name][0] = np.frombuffer(buffer, form, 1, cursor.start + layouts[0][name])[0]
            first = cursor.start + layouts[1][name]
            view = np.ndarray((count - 1,), form, buffer, first, (step,)) if count > 1 else np.empty(0, form)
            records[name][1:] = view
    if not (records["nsec"] < 1_000_000_000).all():
        raise ValueError(f"times with more than a second of nanoseconds in {where}")
    return records


def _starts(fields: tuple[tuple[str, str], ...], cursor: _Cursor, count: int) -> list[int]:
    """Where the first records begin, counted from the start of the fields."""
    starts = [cursor.at - cursor.start]
    while len(starts) < count:
        offsets = _offsets(fields, cursor.ros1, starts[-1])
        starts.append(max(at + _size_of(name, fields) for name, at in offsets.items()))
    return starts


def _offsets(fields: tuple[tuple[str, str], ...], ros1: bool, start: int) -> dict[str, int]:
    at, offsets = start, {}
    for name, kind in fields:
        for part, size in (("sec", 4), ("nsec", 4)) if kind == "time" else ((name, _primitive(kind)),):
            at += 0 if ros1 else -at % size
            offsets[part] = at
            at += size
    return offsets


def _primitive(kind: str) -> int:
    return _SIZES[kind] if kind in _SIZES else _SIZES_64[kind]


def _size_of(column: str, fields: tuple[tuple[str, str], ...]) -> int:
    return 4 if column in ("sec", "nsec") else _primitive(dict(fields)[column])


def _columns(fields: tuple[tuple[str, str], ...], order: str) -> tuple[list[str], list[str]]:
    """Names and NumPy types of what is read of each record."""
    polarity = dict(fields)["polarity"]
    form = f"{order}{'i' if polarity.startswith('int') else 'u'}{_primitive(polarity)}"
    return ["x", "y", "sec", "nsec", "polarity"], [f"{order}u2", f"{order}u2", f"{order}u4", f"{order}u4", form]
