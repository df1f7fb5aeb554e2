"""DAT, AEDAT4 and Event Stream (ES) files, decoded by faery."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from faery import aedat, dat, es
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.checking import check_stream
from core.recordings.sources.making import make_source
from core.recordings.sources.prophesee_header import read_prophesee_header
from core.recordings.sources.source import Columns, EventSource, Report

_AEDAT_MAGIC: Final = len(b"#!AER-DAT4.0\r\n")
_LARGEST: Final = SensorSize(8192, 8192)


def open_dat(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of a Prophesee DAT file."""
    header = read_prophesee_header(path)
    known = sensor or header.sensor

    def open_decoder() -> dat.Decoder:
        # the sizes in the header are checked later, event by event, so that the good ones before are kept
        return dat.Decoder(path, (_LARGEST.width_px, _LARGEST.height_px), "dat2")

    with _refuse_broken(path, open_decoder) as decoder:
        if decoder.event_type != "cd":
            raise RecordingError("a DAT file without events", expected="cd", got=decoder.event_type, where=path)

    def decode(report: Report) -> Iterator[Columns]:
        yield from _decode(path, open_decoder, _dat_columns, report)

    return [make_source(path, "camera", "Prophesee DAT", known, decode, check_stream)]


def open_es(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of an Event Stream file (DVS or ATIS); its rows count from the bottom, ours from the top."""

    def open_decoder() -> es.Decoder:
        return es.Decoder(path, 0)

    with _refuse_broken(path, open_decoder) as decoder:
        kind, dimensions = decoder.event_type, decoder.dimensions
        if kind not in ("dvs", "atis") or dimensions is None:
            raise RecordingError("an Event Stream of this type", expected="dvs or atis", got=kind, where=path)
    height = dimensions[1]

    def columns(packet: NDArray) -> Columns | None:
        if kind == "atis":
            packet = packet[~packet["exposure"]]
        on = packet["polarity"] if kind == "atis" else packet["on"]
        return Columns(packet["t"].astype(np.int64), packet["x"], height - 1 - packet["y"].astype(np.int32), on)

    def decode(report: Report) -> Iterator[Columns]:
        yield from _decode(path, open_decoder, columns, report)

    return [make_source(path, "camera", "Event Stream", sensor or SensorSize(*dimensions), decode, check_stream)]


def open_aedat4(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """Every camera of an iniVation AEDAT4 file, with external trigger edges."""
    with path.open("rb") as file:  # faery panics, noisily, without a header
        file.seek(_AEDAT_MAGIC)
        header_bytes = int.from_bytes(file.read(4), "little")
    if not 8 <= header_bytes <= path.stat().st_size - _AEDAT_MAGIC - 4:
        raise RecordingError("the file cannot be decoded", got="an AEDAT4 file without a header", where=path)

    def open_decoder() -> aedat.Decoder:
        return aedat.Decoder(path)

    with _refuse_broken(path, open_decoder) as decoder:
        tracks = [track for track in decoder.tracks() if track.data_type == "events"]
    if not tracks:
        raise RecordingError("the AEDAT4 file holds no events", where=path)
    sources: list[EventSource] = []
    for track in tracks:
        name = "camera" if len(tracks) == 1 else f"camera{track.id}"
        size = sensor or SensorSize(*(track.dimensions or (0, 0)))
        decode = _aedat_decoder(path, open_decoder, track.id)
        sources.append(make_source(path, name, "AEDAT4", size, decode, check_stream))
    return sources


def _aedat_decoder(
    path: Path, open_decoder: Callable[[], aedat.Decoder], track_id: int
) -> Callable[[Report], Iterator[Columns]]:
    def decode(report: Report) -> Iterator[Columns]:
        def columns(item: tuple[aedat.Track, NDArray]) -> Columns | None:
            track, packet = item
            if track.data_type == "triggers":
                _add_aedat_triggers(packet, report)
            if track.id != track_id:
                return None
            return Columns(packet["t"].astype(np.int64), packet["x"], packet["y"], packet["on"])

        yield from _decode(path, open_decoder, columns, report)

    return decode


def _add_aedat_triggers(packet: NDArray, report: Report) -> None:
    """Sources 1 to 3 of the format are a rising edge, a falling edge and a pulse on the signal input."""
    edges = packet[(packet["source"] >= 1) & (packet["source"] <= 3)]
    report.add_triggers(edges["t"], edges["source"] != 2, np.zeros(len(edges)))


def _dat_columns(packet: NDArray) -> Columns | None:
    return Columns(packet["t"].astype(np.int64), packet["x"], packet["y"], packet["payload"] > 0)


def _decode(path: Path, open_decoder: Callable, columns: Callable, report: Report) -> Iterator[Columns]:
    """Packets until the end or the first error; faery's position is not known, so progress is by events decoded."""
    size = max(1, path.stat().st_size)
    done = 0
    try:
        with open_decoder() as decoder:
            for packet in decoder:
                part = columns(packet)
                if part is not None and len(part.t_us):
                    yield part
                    done += len(part.t_us)
                    report.share = min(0.99, 8.0 * done / size)
    except BaseException as error:
        _raise_unless_of_faery(error)
        report.notes.append(f"{path.name}: stopped: the rest cannot be decoded ({error}).")


def _refuse_broken(path: Path, open_decoder: Callable):
    try:
        return open_decoder()
    except BaseException as error:
        _raise_unless_of_faery(error)
        raise RecordingError("the file cannot be decoded", got=error, where=path) from error


def _raise_unless_of_faery(error: BaseException) -> None:
    """Rust code reports bad input as a RuntimeError, and its own failed checks as a panic, which is no Exception."""
    if not (isinstance(error, (RuntimeError, OSError, ValueError)) or type(error).__name__ == "PanicException"):
        raise error
