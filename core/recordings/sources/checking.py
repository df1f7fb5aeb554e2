"""Makes events out of what a decoder found, as far as it can be trusted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings.layout import MAX_TIME_US
from core.recordings.sources.source import Columns, DecodeReport

_JITTER_US: Final = 1000
"""Steps back up to this are the disorder of a read-out or a network; the event gets the time of the one before it."""
STREAM_PAUSE_US: Final = 600_000_000
"""Ten minutes without one event: in a binary stream rather a damaged time stamp."""

_STRAY_EVENTS: Final = 64


def check_stream(parts: Iterable[Columns], sensor: SensorSize, report: DecodeReport, *, where: str) -> Iterator[Events]:
    """Events of a binary stream up to the first that cannot be true; the report says where that was."""
    return _check(parts, sensor, report, where, longest_pause_us=STREAM_PAUSE_US, refuse=False)


def check_table(parts: Iterable[Columns], sensor: SensorSize, report: DecodeReport, *, where: str) -> Iterator[Events]:
    """Events of a table, which nobody sorts behind the user's back.

    Raises:
        RecordingError: if time runs backwards or an address lies outside the sensor.
    """
    return _check(parts, sensor, report, where, longest_pause_us=MAX_TIME_US, refuse=True)


def _check(
    parts: Iterable[Columns],
    sensor: SensorSize,
    report: DecodeReport,
    where: str,
    *,
    longest_pause_us: int,
    refuse: bool,
) -> Iterator[Events]:
    first_us: int | None = None
    latest_us = 0
    count, moved = 0, 0
    for part in parts:
        if not len(part.t_us):
            continue
        t_us = np.asarray(part.t_us, np.int64)
        first_us = int(t_us[0]) if first_us is None else first_us
        steps = np.diff(t_us, prepend=latest_us if count else t_us[0])
        good, reason = _good_prefix(part, t_us, steps, sensor, first_us, longest_pause_us)
        if reason and refuse:
            remedy = "sort the events by time" if "back" in reason else "check the sensor size (--width, --height)"
            raise RecordingError(f"event {count + good:,} cannot be used: {reason}", where=where, remedy=remedy)
        if "back" in reason:
            good = _without_strays(t_us, good)
        backwards = int(np.count_nonzero(steps[:good] < 0))
        if backwards:
            moved += backwards
            t_us = np.maximum.accumulate(np.maximum(t_us[:good], latest_us if count else t_us[0]))
        if good:
            yield Events.from_columns(t_us[:good], part.x_px[:good], part.y_px[:good], part.on[:good], sensor)
            count += good
            latest_us = int(t_us[good - 1])
        if reason:
            report.notes.append(f"{where}: stopped at event {count:,}: {reason}.")
            break
    if moved:
        report.notes.append(f"{where}: {moved:,} events came up to 1 ms too early; they have the time before them.")


def _good_prefix(
    part: Columns, t_us: NDArray[np.int64], steps: NDArray, sensor: SensorSize, first_us: int, longest_pause_us: int
) -> tuple[int, str]:
    """How many events at the start are good, and what is wrong with the next one ("" if nothing)."""
    x_px, y_px = part.x_px, part.y_px
    tests = (
        ((x_px >= sensor.width_px) | (x_px < 0), lambda i: f"column {x_px[i]} outside the {sensor} sensor"),
        ((y_px >= sensor.height_px) | (y_px < 0), lambda i: f"row {y_px[i]} outside the {sensor} sensor"),
        (steps < -_JITTER_US, lambda i: f"time runs {-steps[i]:,} us back"),
        (steps > longest_pause_us, lambda i: f"time jumps {steps[i]:,} us ahead"),
        (t_us - first_us >= MAX_TIME_US, lambda i: "its time is more than a day after the first"),
    )
    good, reason = len(t_us), ""
    for bad, describe in tests:
        at = int(np.argmax(bad))
        if bad[at] and at < good:
            good, reason = at, describe(at)
    return good, reason


def _without_strays(t_us: NDArray[np.int64], good: int) -> int:
    """Where time comes back, not the time that comes back may be wrong, but the few that ran ahead of it."""
    ahead = int(np.count_nonzero(t_us[:good] > t_us[good]))
    return good - ahead if ahead <= _STRAY_EVENTS else good
