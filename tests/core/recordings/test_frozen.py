"""A part of one camera held in memory."""

from pathlib import Path

import numpy as np

from core.recordings import open_recording
from core.recordings.recording import freeze_camera


def test_a_held_part_is_as_it_was_after_the_recording_is_closed(serve_recording: Path) -> None:
    with open_recording(serve_recording) as recording:
        stream = recording.cameras["left"]
        held = freeze_camera(stream, 100_000, 200_000)
        there = stream.slice(150_000, 160_000)
        assert (held.name, held.sensor, held.truth is not None) == ("left", stream.sensor, True)
        np.testing.assert_array_equal(held.counts_per_ms(), stream.counts_per_ms())
    same = held.slice(150_000, 160_000)
    np.testing.assert_array_equal(same.t_us, there.t_us)
    np.testing.assert_array_equal(same.x_px, there.x_px)
    assert len(held.slice(0, 100_000)) == len(held.slice(200_000, 600_000)) == 0
    assert held.event_count == int(held.counts_per_ms()[100:200].sum())
