"""A recording whose file is deleted, replaced or cut while it is open: what was open stays, or one line says why."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording

SENSOR = SensorSize(640, 480)
DURATION_US = 400_000


@pytest.fixture
def recording_file(tmp_path: Path, make_events) -> tuple[Path, Events]:
    events = make_events(200_000, seed=4, duration_us=DURATION_US, sensor=SENSOR)
    with RecordingWriter(tmp_path / "a.h5", {"left": SENSOR}) as writer:
        writer.append("left", events)
    return tmp_path / "a.h5", events


@pytest.mark.parametrize("how", ["deleted", "replaced"])
def test_what_is_open_stays_though_its_file_is_deleted_or_replaced(recording_file, tmp_path: Path, how: str) -> None:
    path, events = recording_file
    with open_recording(path) as recording:
        if how == "deleted":
            path.unlink()
        else:
            (tmp_path / "other").write_bytes(b"another file")
            os.replace(tmp_path / "other", path)
        np.testing.assert_array_equal(recording.cameras["left"].slice(0, DURATION_US).t_us, events.t_us)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_file_that_is_cut_while_it_is_open_gives_what_is_left_or_one_clear_line(recording_file, share: float) -> None:
    path, events = recording_file
    refusals: list[str] = []
    with open_recording(path) as recording:
        os.truncate(path, int(share * path.stat().st_size))
        for start_us in range(0, DURATION_US, 40_000):
            inside = (events.t_us >= start_us) & (events.t_us < start_us + 40_000)
            try:
                found = recording.cameras["left"].slice(start_us, start_us + 40_000)
            except RecordingError as error:
                refusals.append(str(error))
                continue
            np.testing.assert_array_equal(found.t_us, events.t_us[inside])
    assert refusals and all(str(path) in line and "\n" not in line for line in refusals)
