"""A camera's events in slices, the input of every event format."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, check_cancelled
from core.errors import CommandError
from core.events import Events
from core.recordings import CameraStream, Recording

SLICE_US: Final = 100_000


def event_slices(stream: CameraStream, span: Span, progress: Progress, cancelled: Cancelled) -> Iterator[Events]:
    """Yield events slice by slice; times count from the start of the span."""
    for start in range(span.start_us, span.end_us, SLICE_US):
        check_cancelled(cancelled)
        events = stream.slice(start, min(start + SLICE_US, span.end_us))
        yield Events.from_columns(events.t_us - span.start_us, events.x_px, events.y_px, events.on, events.sensor)
        progress(min(1.0, (start + SLICE_US - span.start_us) / span.length_us))


def share_of(number: int, count: int, progress: Progress) -> Progress:
    """Progress function of part `number` of `count` equal parts."""
    return lambda share: progress((number + share) / count)


def check_cameras(recording: Recording) -> list[str]:
    """Names of the recording's event cameras.

    Raises:
        CommandError: if there is none.
    """
    if not recording.cameras:
        raise CommandError("the recording has no event camera")
    return list(recording.cameras)
