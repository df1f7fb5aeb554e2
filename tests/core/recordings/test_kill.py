"""A writer that is killed loses nothing that it flushed."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from core.recordings.blocks import CHUNK_EVENTS
from core.recordings.growing import scan

SENSOR = SensorSize(640, 480)

WRITE_FOREVER = """
import sys
from pathlib import Path
import numpy as np
from core.events import Events, SensorSize
from core.recordings import RecordingWriter
sensor = SensorSize(640, 480)
with RecordingWriter(Path(sys.argv[1]), {"left": sensor, "right": sensor}) as writer:
    done = 0
    for batch in range(int(sys.argv[2])):
        rows = np.arange(done, done + 7001)
        events = Events.from_columns(rows * 3, rows % 640, rows % 480, rows % 3 == 0, sensor)
        writer.append("left", events)
        writer.append("right", events)
        writer.append_rows("/racket", {"t_us": np.array([batch])})
        done += 7001
        writer.flush()
        print(done, flush=True)
print("closed", flush=True)
"""


def written_events(count: int) -> Events:
    rows = np.arange(count)
    return Events.from_columns(rows * 3, rows % 640, rows % 480, rows % 3 == 0, SENSOR)


def kill_after(path, seconds: float, batches: int) -> int:
    """Start a writer, kill it, and return how many events it said it had flushed."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE_FOREVER, str(path), str(batches)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    first = process.stdout.readline()
    time.sleep(seconds)
    os.kill(process.pid, signal.SIGKILL)
    said = [line for line in [first, *process.stdout.readlines()] if line.endswith("\n") and line.strip().isdigit()]
    process.wait()
    return int(said[-1])


@pytest.mark.parametrize("number", range(5))
def test_everything_flushed_before_a_kill_at_any_moment_is_there(tmp_path, number):
    path = tmp_path / "a.h5"
    # a writer of 40 batches soon closes: late kills hit the moment in which the log becomes HDF5
    flushed = kill_after(path, random.Random(number).uniform(0.0, 0.4), batches=40 if number % 2 else 100_000)
    recording = open_recording(path)
    for camera in recording.cameras.values():
        assert camera.event_count >= flushed
        expected = written_events(camera.event_count)
        found = camera.slice(0, recording.duration_us)
        np.testing.assert_array_equal(found.t_us, expected.t_us)
        np.testing.assert_array_equal(found.y_px, expected.y_px)
        np.testing.assert_array_equal(found.on, expected.on)
        assert camera.counts_per_ms().sum() == camera.event_count
    recording.close()
    with h5py.File(path) as file:  # opening repaired it for everybody
        assert len(file["racket/t_us"]) >= flushed // 7001
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]


def test_the_notes_of_a_killed_recording_say_what_was_recovered(tmp_path):
    path = tmp_path / "a.h5"
    kill_after(path, 0.0, batches=100_000)
    recording = open_recording(path)
    total = sum(camera.event_count for camera in recording.cameras.values())
    assert f"stopped before it closed the recording: {total:,} events were recovered" in recording.notes[-1]
    recording.close()


@pytest.fixture
def log(tmp_path, make_events):
    """The bytes of a growing recording of 2 * CHUNK_EVENTS + 1000 events, flushed and left."""
    path = tmp_path / "log.h5"
    writer = RecordingWriter(path, {"left": SENSOR})
    writer.append("left", make_events(2 * CHUNK_EVENTS + 1000, seed=1, duration_us=10**6, sensor=SENSOR))
    writer.flush()
    data = path.read_bytes()
    writer.discard()
    return data


def test_a_log_cut_or_damaged_anywhere_gives_its_good_prefix_or_one_clear_error(tmp_path, log, make_events):
    events = make_events(2 * CHUNK_EVENTS + 1000, seed=1, duration_us=10**6, sensor=SENSOR)
    rng = np.random.default_rng(3)
    counts = set()
    (tmp_path / "whole.h5").write_bytes(log)
    with (tmp_path / "whole.h5").open("rb") as file:
        start_frame_end = next(scan(file, check=True)).offset
    for number in range(60):
        path = tmp_path / f"{number}.h5"
        position = int(rng.integers(16, len(log)))
        if number % 2:
            data = log[:position]
        else:
            data = bytearray(log)
            data[position : position + 40] = rng.bytes(40)
            data = bytes(data[: len(log)])
        path.write_bytes(data)
        if position < start_frame_end:  # only a damaged beginning is a loss
            with pytest.raises(RecordingError, match="stopped before it began"):
                open_recording(path)
            continue
        recording = open_recording(path)
        camera = recording.cameras["left"]
        counts.add(camera.event_count)
        found = camera.slice(0, 10**6)
        np.testing.assert_array_equal(found.t_us, events.t_us[: len(found)])
        assert camera.event_count in (0, CHUNK_EVENTS, 2 * CHUNK_EVENTS, 2 * CHUNK_EVENTS + 1000)
        recording.close()
    assert len(counts) >= 3


def test_a_full_disk_is_one_clear_error_and_keeps_what_was_written(tmp_path):
    script = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, 600_000))
from core.errors import RecordingError
try:
    exec(sys.argv[3])
except RecordingError as error:
    print(error)
"""
    path = tmp_path / "a.h5"
    result = subprocess.run(
        [sys.executable, "-c", script, str(path), "100000", WRITE_FOREVER], capture_output=True, text=True, check=True
    )
    assert result.stderr == ""
    assert "the recording could not be written to disk; got File too large; free some space" in result.stdout
    flushed = max(int(line) for line in result.stdout.split("\n") if line.isdigit())
    recording = open_recording(path)
    assert recording.cameras["left"].event_count >= flushed > 0
    recording.close()


def test_what_a_kill_during_the_last_step_leaves_is_cleared_away(tmp_path, log):
    path = tmp_path / "a.h5"
    path.write_bytes(log)
    (tmp_path / ".a.h5.assembling").write_bytes(b"half an HDF5 file")
    with open_recording(path) as recording:
        assert recording.cameras["left"].event_count == 2 * CHUNK_EVENTS + 1000
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]


def test_a_disk_too_full_for_the_last_step_loses_nothing(tmp_path, make_events, monkeypatch):
    path = tmp_path / "a.h5"
    writer = RecordingWriter(path, {"left": SENSOR})
    writer.append("left", make_events(1000, seed=1, duration_us=1000, sensor=SENSOR))
    with monkeypatch.context() as patch:
        patch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=0))
        with pytest.raises(RecordingError, match=r"the disk is too full .* got 0 MB; free some space and open it"):
            writer.close()
    with open_recording(path) as recording:
        assert recording.cameras["left"].event_count == 1000
