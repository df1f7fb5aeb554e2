"""A writer that is killed loses nothing that it flushed."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from core.recordings.blocks import CHUNK_EVENTS
from core.recordings.log.growing import HEAD, MARKER
from core.recordings.log.scanning import Frame, scan_damaged

SENSOR = SensorSize(640, 480)
ENDLESS = 100_000
"""Batches; a writer of so many never closes its recording."""

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


def kill_after(path, flushes: int, batches: int = ENDLESS) -> int:
    """Start a writer, kill it soon after so many flushes, and return how many events it said it had flushed."""
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE_FOREVER, str(path), str(batches)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    lines = [process.stdout.readline() for _ in range(flushes)]
    process.kill()
    lines += process.stdout.readlines()
    said = [line for line in lines if line.endswith("\n") and line.strip().isdigit()]
    process.wait()
    return int(said[-1])


@pytest.mark.parametrize(
    ("flushes", "batches"),
    # a writer that closes after its last flush is killed at the moment in which the log becomes HDF5
    [(1, ENDLESS), (37, 40), (60, ENDLESS), (40, 40), (150, ENDLESS)],
)
def test_everything_flushed_before_a_kill_at_any_moment_is_there(tmp_path, flushes, batches):
    path = tmp_path / "a.h5"
    flushed = kill_after(path, flushes, batches)
    assert flushed >= flushes * 7001
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
    kill_after(path, 1)
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


def frames_of(path) -> list[Frame]:
    with path.open("rb") as file:
        return [part for part in scan_damaged(file) if isinstance(part, Frame)]


def test_a_log_cut_or_damaged_anywhere_gives_all_its_good_blocks(tmp_path, log, make_events):
    events = make_events(2 * CHUNK_EVENTS + 1000, seed=1, duration_us=10**6, sensor=SENSOR)
    blocks = [slice(k * CHUNK_EVENTS, (k + 1) * CHUNK_EVENTS) for k in range(3)]
    rng = np.random.default_rng(3)
    (tmp_path / "whole.h5").write_bytes(log)
    ends = [frame.offset + frame.size for frame in frames_of(tmp_path / "whole.h5")]
    assert len(ends) == 5, "the start, three blocks, and the start again"
    lost = set()
    for number in range(60):
        path = tmp_path / f"{number}.h5"
        position = int(rng.integers(16, len(log)))
        cut = number % 2 == 1
        data = bytearray(log[:position] if cut else log)
        data[position : position + 40] = rng.bytes(0 if cut else min(40, len(log) - position))
        path.write_bytes(data)
        begins = [16, *ends]
        hurt = {k for k in range(5) if begins[k] < position + 40 and position < ends[k]}
        gone = {k for k in range(5) if ends[k] > position} if cut else hurt
        if {0, 4} <= gone:
            with pytest.raises(RecordingError, match="stopped before it began"):
                open_recording(path)
            assert path.read_bytes() == bytes(data)
            continue
        kept = [blocks[k - 1] for k in (1, 2, 3) if k not in gone]
        with open_recording(path) as recording:
            camera = recording.cameras["left"]
            for column in ("t_us", "x_px", "y_px", "on"):
                expected = np.concatenate(
                    [getattr(events, column)[:0], *(getattr(events, column)[one] for one in kept)]
                )
                np.testing.assert_array_equal(getattr(camera.slice(0, 10**6), column), expected)
            assert camera.event_count == len(expected) == camera.counts_per_ms().sum()
            kept_log = tmp_path / f"{number}.h5.damaged-log"
            if cut:
                assert not kept_log.exists() and len(recording.notes) == 1
            else:
                assert kept_log.read_bytes() == bytes(data)
                assert f"The damaged log is {kept_log.name}." in recording.notes[-1]
                followed = max((k for k in (1, 2, 3) if k not in gone), default=0)
                known = CHUNK_EVENTS * len([k for k in gone if 0 < k < followed])
                lost.add(known)
                assert (f"Lost: {known:,} events of left" in recording.notes[-1]) == (known > 0)
    assert CHUNK_EVENTS in lost


def test_what_follows_damage_is_kept_though_a_block_in_the_middle_lost_its_end(tmp_path, make_events):
    path = tmp_path / "a.h5"
    events = make_events(3 * CHUNK_EVENTS, seed=2, duration_us=10**6, sensor=SENSOR)
    writer = RecordingWriter(path, {"left": SENSOR})
    for part in range(0, len(events), 12_000):
        rows = slice(part, part + 12_000)
        writer.append("left", Events(events.t_us[rows], events.x_px[rows], events.y_px[rows], events.on[rows], SENSOR))
        writer.append_rows("/made_up", {"t_us": np.array([part])})
        writer.flush()
    whole = [frame for frame in frames_of(path) if frame.meta.get("count") == CHUNK_EVENTS]
    data = bytearray(path.read_bytes())
    rows = [frame for frame in frames_of(path) if frame.meta["kind"] == "rows"]
    for frame in (whole[0], rows[4]):
        data[frame.offset + frame.size // 2] ^= 8
    writer.discard()
    path.write_bytes(data)
    with open_recording(path) as recording:
        assert recording.cameras["left"].event_count == 3 * CHUNK_EVENTS - (CHUNK_EVENTS - 24_000)
        expected = np.concatenate([events.t_us[:24_000], events.t_us[CHUNK_EVENTS:]])
        np.testing.assert_array_equal(recording.cameras["left"].slice(0, 10**6).t_us, expected)
        np.testing.assert_array_equal(recording.read_rows("/made_up")["t_us"] // 12_000, [0, 1, 2, 3, 5, 6, 7, 8])
        assert "Its log was damaged in 2 places" in recording.notes[-1]
        assert f"Lost: {CHUNK_EVENTS - 24_000:,} events of left and 1 rows of /made_up" in recording.notes[-1]


def test_each_damaged_log_is_kept_under_a_name_of_its_own(tmp_path, log):
    path = tmp_path / "a.h5"
    (tmp_path / "a.h5.damaged-log").write_bytes(b"of another time")
    data = bytearray(log)
    data[len(log) // 2] ^= 1
    path.write_bytes(data)
    os.link(path, tmp_path / "a.h5.damaged-log-2")  # by an opening that was killed before it had finished
    open_recording(path).close()
    open_recording(path).close()
    assert (tmp_path / "a.h5.damaged-log").read_bytes() == b"of another time"
    assert (tmp_path / "a.h5.damaged-log-2").read_bytes() == bytes(data)
    assert len(list(tmp_path.iterdir())) == 3


class MeteredFile(io.FileIO):
    """A file that refuses to be read for ever."""

    bytes_read = 0

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(-1 if size is None else size) or b""
        self.bytes_read += len(data)
        assert self.bytes_read < 6 * os.fstat(self.fileno()).st_size, "many times the whole file"
        return data


def test_a_search_in_a_log_full_of_false_beginnings_reads_it_a_few_times_only(tmp_path, log):
    path = tmp_path / "a.h5"
    false = HEAD.pack(MARKER, 14, 4_000_000, 1) + b'{"kind":"end"}'
    path.write_bytes(log + false * 150_000)
    with MeteredFile(path) as file:
        assert len([part for part in scan_damaged(file) if isinstance(part, Frame)]) == 5
        assert file.bytes_read > 2 * len(log) + len(false) * 150_000, "it did search"
    with open_recording(path) as recording:
        assert recording.cameras["left"].event_count == 2 * CHUNK_EVENTS + 1000
        assert "what the last of them held, if anything" in recording.notes[-1]


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
