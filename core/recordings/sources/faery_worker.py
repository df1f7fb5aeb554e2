"""Decodes one file with faery, in a process of its own: `python faery_worker.py es|aedat4 PATH [TRACK]`.

A damaged AEDAT4 file can make faery abort its whole process, and Rust reports to standard error what it likes. Here
that harms nobody. The answers go to standard output as messages of kind (one byte), length (uint64) and content:
    I  the file: JSON with "type" and the "tracks" that hold events, a list of [number, width, height]
    E  events: t uint64, x uint16, y uint16, on uint8, column by column
    T  triggers: t uint64, source uint8
    X  an error, which ends the events: text
    Z  the end
This file is run as it is and imports nothing of this project, so that it starts quickly.
"""

from __future__ import annotations

import json
import os
import struct
import sys
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from faery import aedat, es

try:
    import resource
except ImportError:  # Windows: there nothing limits the worker
    resource = None

MEMORY_BYTES = 4 << 30
"""A damaged file may claim any size; what it asks for beyond this ends the worker instead of the machine."""


def main(kind: str, path: str, track: int | None) -> None:
    """Decode one file and send its events over standard output; a failure is sent, too."""
    if resource is not None:
        with suppress(ValueError, OSError):  # macOS may know no such limit
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    try:
        {"es": _decode_es, "aedat4": _decode_aedat4}[kind](path, track)
        _send(b"Z")
    except BaseException as error:  # noqa: BLE001 (a panic of Rust is no Exception)
        _send(b"X", " ".join(str(error).split()).encode())
    os._exit(0)  # decoders that failed may abort when they are taken down


def _decode_es(path: str, _: int | None) -> None:
    """Rows of the format count from the bottom, ours from the top."""
    decoder = es.Decoder(path, 0)
    width, height = decoder.dimensions or (0, 0)
    kind = decoder.event_type
    _send_info(kind, [(0, width, height)])
    for packet in decoder:
        if kind == "atis":
            packet = packet[~packet["exposure"]]
        on = packet["polarity"] if kind == "atis" else packet["on"]
        _send_events(packet["t"], packet["x"], height - 1 - packet["y"], on)


def _decode_aedat4(path: str, track: int | None) -> None:
    decoder = aedat.Decoder(path)
    tracks = [item for item in decoder.tracks() if item.data_type == "events"]
    sizes = [item.dimensions or (0, 0) for item in tracks]
    _send_info("events", [(item.id, size[0], size[1]) for item, size in zip(tracks, sizes, strict=True)])
    wanted = tracks[0].id if track is None and tracks else track
    for item, packet in _aedat4_packets(decoder):
        if item.id == wanted:
            _send_events(packet["t"], packet["x"], packet["y"], packet["on"])
        elif item.data_type == "triggers":
            _send(b"T", packet["t"].astype("<u8").tobytes() + packet["source"].astype("u1").tobytes())


def _aedat4_packets(decoder: aedat.Decoder) -> Iterator[tuple[aedat.Track, np.ndarray]]:
    for item, packet in decoder:
        if isinstance(packet, np.ndarray):
            yield item, packet


def _send_info(kind: str, tracks: list[tuple[int, int, int]]) -> None:
    _send(b"I", json.dumps({"type": kind, "tracks": tracks}).encode())


def _send_events(t: np.ndarray, x: np.ndarray, y: np.ndarray, on: np.ndarray) -> None:
    columns = ((t, "<u8"), (x, "<u2"), (y, "<u2"), (on, "u1"))
    _send(b"E", b"".join(column.astype(dtype).tobytes() for column, dtype in columns))


def _send(kind: bytes, content: bytes = b"") -> None:
    sys.stdout.buffer.write(struct.pack("<cQ", kind, len(content)) + content)
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else None)
