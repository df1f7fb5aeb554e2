"""A source from a decoder; for files that do not name their sensor size, one is assumed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final, Protocol

from core.events import Events, SensorSize
from core.recordings.sources.source import Columns, DecodeReport, EventSource

_USUAL: Final = tuple(
    SensorSize(*size)
    for size in ((128, 128), (240, 180), (304, 240), (320, 240), (320, 320), (346, 260), (640, 480), (1280, 720))
)
_LARGEST_PX: Final = 8192


class Check(Protocol):
    """A check of a source: `check_stream` or `check_table`."""

    def __call__(
        self, parts: Iterable[Columns], sensor: SensorSize, report: DecodeReport, *, where: str
    ) -> Iterator[Events]: ...


def make_source(
    path: Path,
    name: str,
    label: str,
    sensor: SensorSize | None,
    decode: Callable[[DecodeReport], Iterator[Columns]],
    check: Check,
) -> EventSource:
    """The camera `name` of a file whose columns `decode` finds."""
    size = sensor or _assume_sensor(decode(DecodeReport()))

    def read(report: DecodeReport) -> Iterator[Events]:
        if sensor is None:
            report.notes.append(f"{path.name} does not name its sensor size; {size} is assumed from the events.")
        return check(decode(report), size, report, where=path.name)

    return EventSource(name, label, size, read)


def _assume_sensor(parts: Iterable[Columns]) -> SensorSize:
    """The smallest usual sensor that all events fit on, else one just large enough."""
    width, height = 1, 1
    for part in parts:
        if len(part.t_us):
            width, height = max(width, int(part.x_px.max()) + 1), max(height, int(part.y_px.max()) + 1)
    for sensor in _USUAL:
        if width <= sensor.width_px and height <= sensor.height_px:
            return sensor
    return SensorSize(min(width, _LARGEST_PX), min(height, _LARGEST_PX))
