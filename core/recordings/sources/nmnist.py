"""The 40-bit events of N-MNIST and N-Caltech101 (.bin): x, y, ON and 23 bits of time in us, without a header.

Source: the description of the data sets (Orchard 2015). A y of 240 is no event: it says that 8,192 us have passed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.recordings.sources.checking import (
    CUT_SHORT,
    FEW_LEFT_OUT,
    MAX_LEFT_OUT,
    check_stream,
    note_padding,
    without_padding,
)
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource, Whence

EVENT_BYTES: Final = 5
_OVERFLOW_Y: Final = 240
_OVERFLOW_US: Final = 1 << 13
_N_MNIST: Final = SensorSize(34, 34)
_ENOUGH: Final = 100
"""Above so many events a few may be odd; of other bytes, half of the times would decrease."""
_LARGEST_BYTES: Final = 64 << 20
"""A sample lasts a third of a second."""


def open_nmnist(path: Path, sensor: SensorSize | None) -> list[EventSource] | None:
    """The one camera of a sample; None if the bytes are not such events: times that hardly ever decrease tell."""
    size = path.stat().st_size
    if path.suffix.lower() != ".bin" or not EVENT_BYTES <= size <= _LARGEST_BYTES:
        return None
    rest = size % EVENT_BYTES
    rows = np.frombuffer(path.read_bytes(), np.uint8, size - rest).reshape(-1, EVENT_BYTES)
    rows, padding = without_padding(rows)
    columns = _columns(rows)
    count = len(columns.t_us)
    strays = np.count_nonzero(np.diff(columns.t_us) < 0)
    allowed = max(FEW_LEFT_OUT if count > _ENOUGH else 0, MAX_LEFT_OUT * count)
    if not count or strays > allowed or np.count_nonzero(columns.y_px > _OVERFLOW_Y) > allowed:
        return None
    outside = (columns.x_px >= _N_MNIST.width_px) | (columns.y_px >= _N_MNIST.height_px)
    small = np.count_nonzero(outside) <= allowed

    def decode(report: DecodeReport) -> Iterator[Columns]:
        yield columns
        note_padding(padding, path.name, report)
        note = f"{path.name}: the last {rest} bytes are not a whole event; the file was cut short."
        report.leave_out(CUT_SHORT, rest, note)
        report.share = 1.0

    known = sensor or (_N_MNIST if small else None)
    whence = Whence.FILE if sensor is not None else Whence.DATA_SET
    return [make_source(path, "camera", "N-MNIST, 40-bit events", known, decode, check_stream, sensor_from=whence)]


def _columns(rows: NDArray[np.uint8]) -> Columns:
    x, y, high, middle, low = rows.T.astype(np.int64)
    overflow = y == _OVERFLOW_Y
    t_us = ((high & 0x7F) << 16 | middle << 8 | low) + np.cumsum(overflow) * _OVERFLOW_US
    keep = ~overflow
    return Columns(t_us[keep], x[keep], y[keep], high[keep] >= 128)
