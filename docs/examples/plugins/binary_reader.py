"""A format of event files of your own: `rallyscope import EVENTS.evb DST.h5 --plugin binary_reader.py`.

A file begins with b"EVB1", width and height (u16); then 16 bytes an event: t_us (i64), x, y (u16), on (u8), padding.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources import Columns, DecodeReport, EventSource, make_source, register_reader

MAGIC = b"EVB1"
HEADER = np.dtype([("magic", "S4"), ("width", "<u2"), ("height", "<u2")])
EVENT = np.dtype({"names": ["t", "x", "y", "on"], "formats": ["<i8", "<u2", "<u2", "u1"], "itemsize": 16})
PART = 1 << 20
"""Events that are read at a time."""


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file is of this format, by its first bytes."""
    return head.startswith(MAGIC)


def opens(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file."""
    if path.stat().st_size < HEADER.itemsize:
        raise RecordingError("the header is cut off", where=path)
    header = np.fromfile(path, HEADER, 1)[0]
    size = sensor or SensorSize(int(header["width"]), int(header["height"]))

    def decode(report: DecodeReport) -> Iterator[Columns]:
        whole, rest = divmod(path.stat().st_size - HEADER.itemsize, EVENT.itemsize)
        for first in range(0, whole, PART):
            rows = np.fromfile(path, EVENT, PART, offset=HEADER.itemsize + first * EVENT.itemsize)
            yield Columns(rows["t"], rows["x"], rows["y"], rows["on"] > 0)
            report.share = (first + len(rows)) / whole
        report.leave_out("bytes at the end", rest, f"{path.name}: the last event is cut off.")

    return [make_source(path, "camera", "EVB1", size, decode)]


register_reader("binary-events", recognises, opens, "EVB events", (".evb",))
