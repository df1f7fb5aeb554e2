"""Every recording closes itself at the end of a `with` block."""

from pathlib import Path

import pytest

from app.export.frozen import freeze
from app.export.selection import Span
from core.errors import RecordingError
from core.live.ring_recording import RingRecording
from core.recordings import open_recording


def test_a_file_is_closed_after_the_block(serve_recording: Path) -> None:
    with open_recording(serve_recording) as recording:
        events = recording.cameras["left"].slice(0, 100_000)
    assert len(events)
    with pytest.raises(RecordingError, match="closed"):
        recording.cameras["left"].slice(0, 100_000)


def test_a_file_is_closed_after_an_error(serve_recording: Path) -> None:
    with pytest.raises(ZeroDivisionError), open_recording(serve_recording) as recording:
        _ = 1 // 0
    with pytest.raises(RecordingError, match="closed"):
        recording.check_open()


def test_a_frozen_part_outlives_what_it_was_taken_from(serve_recording: Path) -> None:
    with open_recording(serve_recording) as recording, freeze(recording, Span(100_000, 200_000)) as part:
        count = len(recording.cameras["left"].slice(100_000, 200_000))
    assert len(part.cameras["left"].slice(0, 10**9)) == count > 0


def test_a_ring_forgets_at_the_end_of_the_block() -> None:
    with RingRecording() as ring:
        assert ring.duration_us == 0
    assert ring.ball is None
