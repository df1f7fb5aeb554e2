"""Damaged files of every format: the good part or one clear line, never a crash, a hang or wild times."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import open_recording

CASES = 14
SLOW = ("dat", "es", "aedat4")
"""Each of these starts a process to decode."""
FIRST_US, LAST_US = 7_000_000, 7_300_000
PAUSE_US = 600_000_000
"""A camera may rest; anything beyond is a wild time."""


def try_to_open(path) -> int | None:
    """How many events are there, all checked; None if the file was refused."""
    try:
        recording = open_recording(path, sensor=SensorSize(346, 260))
    except RecordingError:
        return None
    with recording:
        (camera,) = recording.cameras.values()
        events = camera.slice(0, recording.duration_us)
        assert recording.duration_us <= LAST_US - FIRST_US + PAUSE_US
        assert (np.diff(events.t_us) >= 0).all()
        return len(events)


def same_start(path, expected) -> int:
    """How many events at the start are as they were written."""
    with open_recording(path, sensor=SensorSize(346, 260)) as recording:
        (camera,) = recording.cameras.values()
        events = camera.slice(0, recording.duration_us)
        count = min(len(events), len(expected))
        shift = camera.t_offset_us
        same = (events.t_us[:count] + shift == expected.t_us[:count]) & (events.x_px[:count] == expected.x_px[:count])
        return int(np.argmin(np.append(same, False)))


def test_a_file_cut_anywhere_gives_its_good_part_or_one_clear_line(foreign):
    name, path, events = foreign
    data = path.read_bytes()
    rng = np.random.default_rng(11)
    kept = []
    for cut in np.sort(rng.integers(1, len(data), 5 if name in SLOW else CASES)).tolist():
        path.write_bytes(data[:cut])
        kept.append(try_to_open(path) or 0)
    if name in ("evt2", "evt2.1", "evt3", "dat", "es", "csv", "text", "aedat4"):  # formats that can be read in part
        assert kept == sorted(kept)
        assert kept[-1] > 0.5 * len(events)
        assert same_start(path, events) >= kept[-1] - 1


@pytest.mark.parametrize("size", [1, 64, 4096])
def test_garbage_anywhere_gives_the_good_part_or_one_clear_line(foreign, size):
    name, path, _ = foreign
    data = path.read_bytes()
    rng = np.random.default_rng(size)
    for at in rng.integers(0, len(data) - size, 2 if name in SLOW else CASES // 2).tolist():
        path.write_bytes(data[:at] + rng.bytes(size) + data[at + size :])
        try_to_open(path)


@pytest.mark.parametrize("name", ["evt2", "evt3", "dat", "es"])
def test_what_stands_before_the_garbage_is_kept(tmp_path, make_events, write_foreign, name):
    sensor = SensorSize(346, 260)
    events = make_events(100_000, seed=2, duration_us=900_000, sensor=sensor, start_us=FIRST_US)
    path = write_foreign(name, tmp_path / "a", events)
    data = path.read_bytes()
    rng = np.random.default_rng(4)
    for share in (0.3, 0.8):
        at = int(share * len(data))
        path.write_bytes(data[:at] + rng.bytes(4096) + data[at + 4096 :])
        count = try_to_open(path)
        before = (share - 0.02) * len(events)
        if name == "es":  # in front of its events, of five bytes each, stands the time up to the first
            before = (at - (len(data) - 5 * len(events))) / 5
        assert count is not None  # they go on behind it
        assert before - 20 <= same_start(path, events) <= count <= len(events) + 600


@pytest.mark.parametrize("name", ["evt2", "evt2.1", "evt3", "dat"])
def test_what_stands_behind_the_garbage_is_kept_too(tmp_path, make_events, write_foreign, name):
    sensor = SensorSize(346, 260)
    events = make_events(100_000, seed=2, duration_us=900_000, sensor=sensor, start_us=FIRST_US)
    path = write_foreign(name, tmp_path / "a", events)
    data = path.read_bytes()
    at = len(data) // 2 // 8 * 8
    path.write_bytes(data[:at] + np.random.default_rng(4).bytes(512) + data[at + 512 :])
    with open_recording(path, sensor=sensor) as recording:
        (camera,) = recording.cameras.values()
        found = camera.slice(0, recording.duration_us)
        assert len(events) - 400 < len(found) < len(events) + 200
        for column in ("t_us", "x_px", "y_px", "on"):
            here, there = getattr(found, column)[-40_000:], getattr(events, column)[-40_000:]
            np.testing.assert_array_equal(here, there - (FIRST_US if column == "t_us" else 0))
        assert any("damaged" in note or "left out" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"hello world, this is a text\nabout nothing\n", "the text is not events; expected four numbers a line"),
        (b"#!AER-DAT2.0\r\n# This is a raw AE data file", "the header does not name the camera"),
        (b"#!AER-DAT3.1\r\n#Format: RAW\r\n", "the AEDAT 3 header has no end; expected #!END-HEADER"),
        (b"\x00\x01\x02\xff\xfe" * 100, "the format is not recognised"),
        (b"\x89HDF\r\n\x1a\n" + b"\0" * 100, "the HDF5 file cannot be read"),
        (b"PK\x03\x04" + b"\0" * 100, "the NumPy file cannot be read"),
        (b"#!AER-DAT4.0\r\n" + b"\0" * 10, "the file cannot be decoded"),
        (b"Event Stream\x02\x00\x00\x09", "the file cannot be decoded"),
        (b"1 2 3\n4 5 6\n", "the text is not events"),
        (b"# only\n# comments\n", "the text file holds no events"),
        (
            b"% evt 3.0\n% geometry 640x480\nThis is no event data but a letter to a friend.\n",
            "no events could be read",
        ),
        (b"% a LaTeX comment\n\\begin{document}\n", "the text file holds no events|the text is not events"),
    ],
)
def test_what_is_no_event_file_is_refused_in_one_clear_line(tmp_path, data, message):
    path = tmp_path / "recording.raw"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=message) as caught:
        open_recording(path)
    assert "\n" not in str(caught.value)


def test_an_hdf5_file_that_was_cut_short_says_how_much_of_it_is_there(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["events"] = np.arange(10_000)
    whole = path.stat().st_size
    with path.open("r+b") as file:
        file.truncate(whole - 5_000)
    with pytest.raises(RecordingError, match=f"got {whole - 5_000:,} of its {whole:,} bytes: it was cut short"):
        open_recording(path)


def test_a_missing_file_is_one_clear_line(tmp_path):
    with pytest.raises(RecordingError, match="no such file"):
        open_recording(tmp_path / "nothing.raw")


def test_our_own_recording_damaged_anywhere_is_whole_or_refused_but_never_wrong(tmp_path, make_events):
    from core.recordings import RecordingWriter

    sensor = SensorSize(346, 260)
    events = make_events(120_000, seed=2, duration_us=900_000, sensor=sensor)
    path = tmp_path / "a.h5"
    with RecordingWriter(path, {"left": sensor}) as writer:
        writer.append("left", events)
    data = path.read_bytes()
    rng = np.random.default_rng(8)
    refused = 0
    for at in rng.integers(0, len(data) - 16, 40).tolist():
        path.write_bytes(data[:at] + rng.bytes(16) + data[at + 16 :])
        try:
            with open_recording(path) as recording:
                (camera,) = recording.cameras.values()
                found = camera.slice(0, 900_000)
                np.testing.assert_array_equal(found.t_us, events.t_us)
                np.testing.assert_array_equal(found.x_px, events.x_px)
        except RecordingError:
            refused += 1
    assert refused > 20


@pytest.mark.parametrize("at", [281, 500])
def test_a_damaged_aedat4_header_that_makes_its_decoder_abort_is_one_clear_line(tmp_path, shared_data, at):
    data = bytearray((shared_data / "events" / "cars_davis_346x260.aedat4").read_bytes())
    data[at] = 0xFF
    path = tmp_path / "a"
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="the file cannot be decoded"):
        open_recording(path)


@pytest.mark.parametrize(
    "name",
    [
        "cars_davis_346x260.aedat4",
        "plane_320x240.es",
        "rotating_dot_evt2_640x480.raw",
        "walker_evt3_640x480.raw",
        "walker_metavision_ecf.hdf5",
    ],
)
def test_real_files_cut_or_damaged_anywhere_give_events_of_the_same_time_or_one_clear_line(tmp_path, shared_data, name):
    original = shared_data / "events" / name
    data = original.read_bytes()
    with open_recording(original) as recording:
        duration_us = recording.duration_us
        count = sum(camera.event_count for camera in recording.cameras.values())
    path = tmp_path / "a"
    rng = np.random.default_rng(5)
    read = 0
    for case in range(4 if original.suffix in (".aedat4", ".es") else 10):
        at = int(rng.integers(0, len(data) - 4096))
        path.write_bytes(data[:at] if case % 2 else data[:at] + rng.bytes(64) + data[at + 64 :])
        try:
            with open_recording(path) as recording:
                read += 1
                (camera,) = recording.cameras.values()
                assert camera.event_count <= count + 64
                assert recording.duration_us <= duration_us + 1_000_000
                assert (np.diff(camera.slice(0, recording.duration_us).t_us) >= 0).all()
        except RecordingError:
            continue
    assert read > 0
