"""The part of a recording to export, and the time between pictures."""

from __future__ import annotations

from dataclasses import dataclass

from core.errors import CommandError
from core.recordings import Recording

DEFAULT_STRIDE_US = 4000
"""Time between two pictures: 250 a second."""


@dataclass(frozen=True, slots=True)
class Span:
    """[start_us, end_us) on the recording's clock."""

    start_us: int
    end_us: int

    @property
    def length_us(self) -> int:
        """Length of the span."""
        return self.end_us - self.start_us


def span_of(recording: Recording, start_us: int | None = None, end_us: int | None = None) -> Span:
    """Span from the given bounds; None means from the start, or to the end.

    Raises:
        CommandError: if there is no such part.
    """
    start = 0 if start_us is None else start_us
    end = recording.duration_us if end_us is None else min(end_us, recording.duration_us)
    if not 0 <= start < end:
        raise CommandError(
            "no such part of the recording",
            expected=f"a start before the end, both within 0 and {recording.duration_us} us",
            got=f"{start} to {recording.duration_us if end_us is None else end_us} us",
            where="--start-us, --end-us",
        )
    return Span(start, end)
