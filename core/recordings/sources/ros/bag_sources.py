"""Every topic with events is a camera; what the bag knows of it, its lens, its pose and its pictures, comes along.

Times are those of ROS, us since 1970: records carry them. Packets of a Prophesee camera count on its own clock, which
is put on that of ROS by the header of the first packet. Cameras whose clocks agree are taken for synchronised.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings.sources.checking import check_stream
from core.recordings.sources.prophesee_raw import open_prophesee_raw
from core.recordings.sources.ros.bag_cameras import BagCamera, cameras_of
from core.recordings.sources.ros.bag_pictures import pictures_of
from core.recordings.sources.ros.bags import Bag, Topic, open_messages
from core.recordings.sources.ros.event_messages import (
    ARRAY_TYPES,
    PACKET_TYPES,
    RAW_ENCODINGS,
    RECORD_ENCODINGS,
    EventPacketMessage,
    decode_records,
    read_event_array,
    read_event_packet,
)
from core.recordings.sources.source import BINARY_FACTS, Columns, DecodeReport, EventSource

_SYNCHRONISED_US: Final = 20_000
"""Header stamps of two cameras are late by this at most: so cameras whose clocks differ by less share theirs."""
_FIRST_PACKETS: Final = 200
_NO_SIZE: Final = "its messages do not name the size of the sensor; give --width and --height."
_EMPTY_WORDS: Final = ("events", "event", "camera", "dvs", "cd_events_buffer", "cd", "image_raw")
"""Parts of a topic that name no camera."""


@dataclass(frozen=True, slots=True)
class _EventTopic:
    """One camera of a bag."""

    topic: Topic
    sensor: SensorSize
    frame_id: str
    encoding: str | None
    """Encoding of packets; None for arrays of records."""
    clock_us: int
    """Added to the times in its packets to get those of ROS."""


def open_bag(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The cameras of a bag or an MCAP file.

    Raises:
        RecordingError: if it cannot be read, or holds no events.
    """
    bag = open_messages(path)
    kinds = {**dict.fromkeys(ARRAY_TYPES), **dict.fromkeys(PACKET_TYPES)}
    topics = [topic for topic in bag.topics.values() if topic.type in kinds]
    notes: list[str] = []
    found = [one for topic in topics if (one := _first_look(bag, topic, sensor, notes)) is not None]
    if not found:
        if notes:
            raise RecordingError("no events in the bag that can be read", got=" ".join(notes).rstrip("."), where=path)
        there = ", ".join(f"{topic.name} ({topic.type})" for topic in bag.topics.values()) or "nothing"
        expected = ", ".join([*ARRAY_TYPES[:2], PACKET_TYPES[0]])
        raise RecordingError("no events in the bag", expected=f"a topic of {expected}", got=there, where=path)
    assumed: list[str] = []
    found = _on_one_clock(found, assumed)
    names = _names([one.topic.name for one in found])
    calibrated = cameras_of(bag, {one.topic.name: BagCamera(one.sensor, one.frame_id) for one in found}, notes)
    sizes = {one.topic.name: (name, one.sensor) for one, name in zip(found, names, strict=True)}
    pictures = pictures_of(bag, sizes, notes)
    sources: list[EventSource] = []
    for number, (one, name) in enumerate(zip(found, names, strict=True)):
        # What belongs to the whole bag, notes and ordinary cameras, goes with its first source, so that it comes
        # once.
        own = [track for owner, track in pictures if owner == one.topic.name or (owner is None and not number)]
        source = _source(bag, one, name, *((tuple(notes), tuple(assumed)) if not number else ((), ())))
        sources.append(dataclasses.replace(source, calibration=calibrated.get(one.topic.name), pictures=tuple(own)))
    return sources


def _source(bag: Bag, one: _EventTopic, name: str, notes: tuple[str, ...], assumed: tuple[str, ...]) -> EventSource:
    label = one.topic.type.rsplit("/", 1)[-1] + (f", {one.encoding}" if one.encoding else "")
    kind = "ROS 1 bag" if one.topic.ros1 else "ROS 2 bag"
    read = _read_words if one.encoding in RAW_ENCODINGS else _read_records

    def read_events(report: DecodeReport) -> Iterator[Events]:
        report.notes.extend(notes)
        for note in assumed:
            report.assume(note)
        yield from read(bag, one, report)
        report.notes.extend(bag.notes)
        report.share = 1.0

    return EventSource(name, f"{kind} ({label})", one.sensor, read_events, facts=BINARY_FACTS)


def _first_look(bag: Bag, topic: Topic, sensor: SensorSize | None, notes: list[str]) -> _EventTopic | None:
    """What the first messages of a topic say; None, with a note, if it has no events that can be read."""
    if topic.type in ARRAY_TYPES:
        for number, (_, data) in enumerate(bag.messages(topic.name)):
            batch = read_event_array(data, topic)
            size = sensor or _stated(batch.width_px, batch.height_px)
            if size is not None and (len(batch.columns.t_us) or number > _FIRST_PACKETS):
                return _EventTopic(topic, size, batch.frame_id, None, 0)
            if size is None and len(batch.columns.t_us):
                notes.append(f"{topic.name} is left out: {_NO_SIZE}")
                return None
        notes.append(f"{topic.name} is left out: it has no events.")
        return None
    packets: list[EventPacketMessage] = []
    for _, data in bag.messages(topic.name):
        packets.append(read_event_packet(data, topic))
        first = packets[0]
        if first.encoding not in RAW_ENCODINGS and first.encoding not in RECORD_ENCODINGS:
            known = ", ".join([*RAW_ENCODINGS, *RECORD_ENCODINGS])
            notes.append(f"{topic.name} is left out: encoding {first.encoding!r} is not read, only {known}.")
            return None
        size = sensor or _stated(first.width_px, first.height_px)
        if size is None:
            notes.append(f"{topic.name} is left out: {_NO_SIZE}")
            return None
        t_us = _first_event_us(packets, size)
        if t_us is not None:
            stamp_us = packets[0].stamp_ns // 1000
            clock_us = 0 if first.encoding == "libcaer" or not stamp_us else stamp_us - t_us
            return _EventTopic(topic, size, first.frame_id, first.encoding, clock_us)
        if len(packets) > _FIRST_PACKETS:
            break
    notes.append(f"{topic.name} is left out: it has no events.")
    return None


def _stated(width: int, height: int) -> SensorSize | None:
    return SensorSize(width, height) if 0 < width <= 8192 and 0 < height <= 8192 else None


def _first_event_us(packets: list[EventPacketMessage], size: SensorSize) -> int | None:
    """When the first event of some packets was, on the clock of their camera."""
    if packets[0].encoding in RECORD_ENCODINGS:
        columns = decode_records(packets[-1])
        return int(columns.t_us[0]) if len(columns.t_us) else None
    with TemporaryDirectory(prefix="rallyscope-") as folder:
        path = Path(folder) / "first.raw"
        _write_raw(path, packets[0].encoding, size, iter(packets))
        (source,) = open_prophesee_raw(path, size)
        with suppress(RecordingError):
            for events in source.read(DecodeReport()):
                if len(events):
                    return int(events.t_us[0])
    return None


def _on_one_clock(found: list[_EventTopic], notes: list[str]) -> list[_EventTopic]:
    own = [one for one in found if one.encoding in RAW_ENCODINGS or one.encoding == "mono"]
    if not own:
        return found
    clocks = [one.clock_us for one in own]
    if max(clocks) - min(clocks) <= _SYNCHRONISED_US:
        shared = min(clocks)
        if len(own) > 1 and max(clocks) != shared:
            late = max(clocks) - shared
            notes.append(f"The clocks of the cameras agree within {late:,} us of their headers: taken for one clock.")
        return [dataclasses.replace(one, clock_us=shared) if one in own else one for one in found]
    apart = (max(clocks) - min(clocks)) / 1e6
    notes.append(
        f"The cameras have clocks of their own, {apart:,.3f} s apart: each is put on the time of ROS by the header of"
        " its first packet, which may be some ms late."
    )
    return found


def _read_records(bag: Bag, one: _EventTopic, report: DecodeReport) -> Iterator[Events]:
    def columns() -> Iterator[Columns]:
        done = 0
        for _, data in bag.messages(one.topic.name):
            done += 1
            report.share = done / max(1, one.topic.count)
            if one.encoding is None:
                yield read_event_array(data, one.topic).columns
                continue
            packet = read_event_packet(data, one.topic)
            if packet.encoding != one.encoding:
                report.notes.append(f"{one.topic.name}: stopped at a packet of another encoding, {packet.encoding!r}.")
                return
            part = decode_records(packet)
            yield part._replace(t_us=part.t_us + one.clock_us)

    return check_stream(columns(), one.sensor, report, where=one.topic.name)


def _read_words(bag: Bag, one: _EventTopic, report: DecodeReport) -> Iterator[Events]:
    """The words of all packets as the RAW file that they are parts of."""
    with TemporaryDirectory(prefix="rallyscope-") as folder:
        path = Path(folder) / (one.topic.name.strip("/").replace("/", "_") + ".raw")
        packets = (read_event_packet(data, one.topic) for _, data in bag.messages(one.topic.name))
        assert one.encoding is not None
        missing = _write_raw(path, one.encoding, one.sensor, packets)
        note = f"{one.topic.name}: {missing:,} packets are missing by their numbers."
        report.leave_out("missing packets", missing, note)
        (source,) = open_prophesee_raw(path, one.sensor)
        for events in source.read(report):
            t_us = events.t_us + one.clock_us
            t_us.flags.writeable = False
            yield dataclasses.replace(events, t_us=t_us)


def _write_raw(path: Path, encoding: str, size: SensorSize, packets: Iterator[EventPacketMessage]) -> int:
    """Write a RAW file; returns how many packets are missing by their numbers."""
    missing, expected = 0, None
    with path.open("wb") as file:
        file.write(
            f"% format {RAW_ENCODINGS[encoding]};height={size.height_px};width={size.width_px}\n% end\n".encode()
        )
        for packet in packets:
            if packet.encoding == encoding:
                file.write(packet.data)
                missing += max(0, packet.seq - expected) if expected is not None else 0
                expected = packet.seq + 1
    return missing


def _names(topics: list[str]) -> list[str]:
    """Short names for the topics: the parts in which they differ, without those that name no camera."""
    if len(topics) == 1:
        return ["camera"]
    parts = [topic.strip("/").split("/") for topic in topics]
    shared = set.intersection(*(set(one) for one in parts))
    names: list[str] = []
    for topic, own in zip(topics, parts, strict=True):
        left = [part for part in own if part not in shared and part not in _EMPTY_WORDS] or own
        names.append(_plain("_".join(left)) or _plain(topic) or "camera")
    if len(set(names)) != len(names):
        names = [_plain("_".join(own)) for own in parts]
    return [name if names.index(name) == i else f"{name}_{i}" for i, name in enumerate(names)]


def _plain(text: str) -> str:
    return re.sub(r"[^0-9A-Za-z_-]+", "_", text).strip("_")
