"""The 40-bit events of N-MNIST and N-Caltech101 (.bin): x, y, ON and 23 bits of time in us, without a header.

Source: the description of the data sets (Orchard 2015). A y of 240 is no event: it says that 8,192 us have passed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from core.events import SensorSize
from core.recordings.sources.checking import check_stream
from core.recordings.sources.making import make_source
from core.recordings.sources.source import Columns, DecodeReport, EventSource, Whence

EVENT_BYTES: Final = 5
_OVERFLOW_Y: Final = 240
_OVERFLOW_US: Final = 1 << 13
_N_MNIST: Final = SensorSize(34, 34)
_STRAY_SHARE: Final = 0.01
"""Of other bytes, half of the times would decrease."""
_LARGEST_BYTES: Final = 64 << 20
"""A sample lasts a third of a second."""


def open_nmnist(path: Path, sensor: SensorSize | None) -> list[EventSource] | None:
    """The one camera of a sample; None if the bytes are not such events: times that hardly ever decrease tell."""
    size = path.stat().st_size
    if path.suffix.lower() != ".bin" or size % EVENT_BYTES or not 0 < size <= _LARGEST_BYTES:
        return None
    columns = _columns(path.read_bytes())
    strays = np.count_nonzero(np.diff(columns.t_us) < 0)
    if not len(columns.t_us) or strays > _STRAY_SHARE * len(columns.t_us) or columns.y_px.max() > _OVERFLOW_Y:
        return None
    small = columns.x_px.max() < _N_MNIST.width_px and columns.y_px.max() < _N_MNIST.height_px

    def decode(report: DecodeReport) -> Iterator[Columns]:
        yield columns
        report.share = 1.0

    known = sensor or (_N_MNIST if small else None)
    whence = Whence.FILE if sensor is not None else Whence.DATA_SET
    return [make_source(path, "camera", "N-MNIST, 40-bit events", known, decode, check_stream, sensor_from=whence)]


def _columns(data: bytes) -> Columns:
    x, y, high, middle, low = np.frombuffer(data, np.uint8).reshape(-1, EVENT_BYTES).T.astype(np.int64)
    overflow = y == _OVERFLOW_Y
    t_us = ((high & 0x7F) << 16 | middle << 8 | low) + np.cumsum(overflow) * _OVERFLOW_US
    keep = ~overflow
    return Columns(t_us[keep], x[keep], y[keep], high[keep] >= 128)
