"""N-MNIST and N-Caltech101 (.bin): `rallyscope import 00002.bin DST.h5 --plugin n_mnist_reader.py`.

40 bits an event: x, y, ON and 23 bits of time in us, without a header. A y of 240 is no event: it says that 8,192 us
have passed. Source: the description of the data sets (Orchard 2015).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.foreign_tables import ODD_SHARE, allowed_odd
from core.recordings.sources import Columns, DecodeReport, EventSource, FactOrigin, make_source, register_reader
from core.recordings.sources.checking import CUT_SHORT, note_padding, without_padding
from core.recordings.sources.readers import READERS
from core.text import compression_of

EVENT_BYTES = 5
OVERFLOW_Y = 240
OVERFLOW_US = 1 << 13
SENSOR = SensorSize(34, 34)
ENOUGH = 100
"""Above so many events a few may be odd; of other bytes, half of the times would decrease."""
LARGEST_BYTES = 64 << 20
"""A sample lasts a third of a second."""
OTHERS = tuple(READERS.registered().values())
"""Formats that are recognised by how their files begin: what begins so is none of these."""


def recognises(path: Path, head: bytes) -> bool:
    """Whether the bytes are such events: there is no header, but times that hardly ever decrease tell."""
    if path.suffix.lower() != ".bin" or not EVENT_BYTES <= path.stat().st_size <= LARGEST_BYTES:
        return False
    if compression_of(head) is not None or any(one.recognises(path, head) for one in OTHERS):
        return False
    columns, _, _ = read(path)
    strays = np.count_nonzero(np.diff(columns.t_us) < 0)
    beyond = np.count_nonzero(columns.y_px > OVERFLOW_Y)
    return len(columns.t_us) > 0 and max(int(strays), int(beyond)) <= most_odd(columns)


def opens(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of a sample; its size is assumed to be that of N-MNIST where the addresses fit."""
    columns, padding, rest = read(path)
    outside = (columns.x_px >= SENSOR.width_px) | (columns.y_px >= SENSOR.height_px)

    def decode(report: DecodeReport) -> Iterator[Columns]:
        yield columns
        note_padding(padding, path.name, report)
        note = f"{path.name}: the last {rest} bytes are not a whole event; the file was cut short."
        report.leave_out(CUT_SHORT, rest, note)
        report.share = 1.0

    known = sensor or (SENSOR if np.count_nonzero(outside) <= most_odd(columns) else None)
    origin = FactOrigin.FILE if sensor is not None else FactOrigin.DATA_SET
    return [make_source(path, "camera", "N-MNIST, 40-bit events", known, decode, sensor_from=origin)]


def read(path: Path) -> tuple[Columns, int, int]:
    """The events, how many rows are padding, and how many bytes follow the last whole event."""
    data = path.read_bytes()
    whole, rest = divmod(len(data), EVENT_BYTES)
    rows, padding = without_padding(np.frombuffer(data, np.uint8, whole * EVENT_BYTES).reshape(-1, EVENT_BYTES))
    return columns_of(rows), padding, rest


def columns_of(rows: NDArray[np.uint8]) -> Columns:
    """The columns of rows (N, 5)."""
    x, y, high, middle, low = rows.T.astype(np.int64)
    overflow = y == OVERFLOW_Y
    t_us = ((high & 0x7F) << 16 | middle << 8 | low) + np.cumsum(overflow) * OVERFLOW_US
    keep = ~overflow
    return Columns(t_us[keep], x[keep], y[keep], high[keep] >= 128)


def most_odd(columns: Columns) -> float:
    """How many of the events may be odd."""
    count = len(columns.t_us)
    return allowed_odd(count) if count > ENOUGH else ODD_SHARE * count


register_reader("n-mnist", recognises, opens, "N-MNIST", only_named=(".bin",))
