"""What cameras send is written as it comes, and becomes the recording that it was; what is lost is counted."""

from __future__ import annotations

import errno
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.devices.neuromorphic import open_camera
from core.devices.raw_recorder import Evt3Clock, GapResynchroniser, RawRecorder, count_events, raw_path
from core.errors import RecordingError
from core.events import Events, SensorSize
from core.events.clock_table import read_clock_table
from core.recordings import ImportOrder, import_recording, open_recording
from core.recordings.evt3_encoder import Evt3Encoder
from tests.core.devices.replayed_hardware import ENDLESS, RING, Replayed, ReplayedLibrary
from tests.waiting import eventually

SENSOR = SensorSize(1280, 720)
LONG_US = 10**9


class Pixels:
    """An event every 10 us, each known by its place."""

    sensor = SENSOR

    def slice(self, start_us: int, end_us: int) -> Events:
        numbers = np.arange(-(-start_us // 10), -(-end_us // 10))
        return Events.from_columns(numbers * 10, numbers % 1280, numbers // 1280 % 720, numbers % 3 == 0, SENSOR)


def recorder_of(
    cameras: dict[str, Replayed], out: Path, *, cable: bool = True, hold: bool = False, clock=time.monotonic
) -> tuple[RawRecorder, ReplayedLibrary]:
    """A recorder and the cameras' library. No camera loses anything because the machine stood still."""
    patient = (replace(one, ring=ENDLESS) if one.ring == RING else one for one in cameras.values())
    library = ReplayedLibrary({f"000{k}": one for k, one in enumerate(patient)}, hold=hold, clock=clock)
    devices = {name: open_camera(f"000{k}", raw=True, driver=library) for k, name in enumerate(cameras)}
    return RawRecorder(devices, out, cable=cable), library


def test_two_cameras_with_a_cable_become_the_recording_that_they_saw(tmp_path):
    out = tmp_path / "take.h5"
    camera = Replayed(stream=Pixels(), duration_us=500_000)
    recorder, library = recorder_of({"left": camera, "right": camera}, out)
    eventually(lambda: all(device._sent > 520 for device in library.opened), "the whole recording to be sent")
    takes = recorder.stop()
    assert all(device.closed for device in library.opened)
    assert all(one.packets_dropped == one.gaps == 0 and not one.problem for one in takes)
    summary = import_recording(ImportOrder([one.path for one in takes], names=[one.name for one in takes]), out)
    assert summary.events == {"left": 50_000, "right": 50_000}
    with open_recording(out) as recording:
        known = Pixels().slice(0, 500_000)
        for stream in recording.cameras.values():
            found = stream.slice(0, 600_000)
            for column in ("t_us", "x_px", "y_px", "on"):
                np.testing.assert_array_equal(getattr(found, column), getattr(known, column))
    head = takes[0].path.read_bytes()[:400]
    assert b"% serial_number 0000" in head and b"% bias_diff_on 0" in head and b"% geometry 1280x720" in head


def test_without_a_cable_the_drift_is_written_beside_and_undone(tmp_path):
    out = tmp_path / "take.h5"
    cameras = {
        "left": Replayed(stream=Pixels(), duration_us=LONG_US),
        "right": Replayed(stream=Pixels(), duration_us=LONG_US, offset_us=5_000_000, drift=200e-6, jitter_s=0.001),
    }
    recorder, _ = recorder_of(cameras, out, cable=False)
    eventually(lambda: recorder.clock_paths["right"].read_bytes().count(b"\n") > 3, "three lines of the clock's table")
    takes = recorder.stop()
    table = read_clock_table(recorder.clock_paths["right"])
    assert abs(int(table.shift_us[0]) + 5_000_000) < 2000
    import_recording(ImportOrder([one.path for one in takes], clock=[table]), out)
    with open_recording(out) as recording:
        left, right = (recording.cameras[name].slice(0, 3_000_000) for name in ("left", "right"))
    times = {(x, y): t for t, x, y in zip(left.t_us, left.x_px, left.y_px, strict=True)}
    pairs = zip(right.t_us, right.x_px, right.y_px, strict=True)
    apart = np.array([t - times[x, y] for t, x, y in pairs if (x, y) in times])
    assert len(apart) > 100_000 and np.abs(apart).max() < 1000 and abs(np.median(apart)) < 300


def test_each_of_three_cameras_has_a_clock_and_one_recording_is_made_of_all(tmp_path):
    out = tmp_path / "take.h5"
    shifts_us = {"a": 0, "b": 5_000_000, "c": 700_000}
    cameras = {
        name: Replayed(stream=Pixels(), duration_us=LONG_US, offset_us=shift) for name, shift in shifts_us.items()
    }
    recorder, _ = recorder_of(cameras, out, cable=False)
    assert list(recorder.clock_paths) == ["b", "c"]
    eventually(
        lambda: all(path.read_bytes().count(b"\n") > 1 for path in recorder.clock_paths.values()),
        "a line of each clock's table",
    )
    takes = recorder.stop()
    tables = [read_clock_table(path) for path in recorder.clock_paths.values()]
    import_recording(ImportOrder([one.path for one in takes], clock=tables), out)
    with open_recording(out) as recording:
        assert list(recording.cameras) == ["a", "b", "c"]
        found = [stream.slice(0, 3_000_000) for stream in recording.cameras.values()]
    times = {(x, y): t for t, x, y in zip(found[0].t_us, found[0].x_px, found[0].y_px, strict=True)}
    for events in found[1:]:
        pairs = zip(events.t_us, events.x_px, events.y_px, strict=True)
        apart = np.array([t - times[x, y] for t, x, y in pairs if (x, y) in times])
        assert len(apart) > 10_000 and abs(np.median(apart)) < 2_000


def test_a_short_take_without_a_cable_has_the_shift_that_was_known(tmp_path):
    out = tmp_path / "take.h5"
    cameras = {
        "left": Replayed(stream=Pixels(), duration_us=LONG_US),
        "right": Replayed(stream=Pixels(), duration_us=LONG_US, offset_us=5_000_000),
    }
    recorder, library = recorder_of(cameras, out, cable=False)
    eventually(lambda: all(device.sent_us > 100_000 for device in library.opened), "0.1 s of both cameras")
    takes = recorder.stop()
    table = read_clock_table(recorder.clock_paths["right"])
    assert len(table.stamp_us) >= 1 and abs(int(table.shift_us[0]) + 5_000_000) < 50_000
    seen_us = max(device.sent_us for device in library.opened)
    duration_us = import_recording(ImportOrder([one.path for one in takes], clock=[table]), out).duration_us
    assert duration_us < seen_us + 1_000_000, "the 5 s between the clocks are undone"


def test_a_table_of_clocks_of_a_silent_camera_shifts_nothing(tmp_path):
    (tmp_path / "clock.csv").write_text("stamp_us,shift_us\n")
    table = read_clock_table(tmp_path / "clock.csv")
    assert not table.known and table.shifted(np.array([5])).tolist() == [5]


def test_losses_of_the_driver_are_counted_to_the_event_and_the_rest_is_in_its_place(tmp_path):
    out = tmp_path / "take.h5"
    camera, now_s = Replayed(stream=Pixels(), duration_us=2_000_000, ring=30), 1.0
    recorder, library = recorder_of({"only": camera}, out, hold=True, clock=lambda: now_s)
    library.began_s = 0.0  # a second of packets waits for a ring of 30
    device = library.opened[0]
    eventually(lambda: device.sent_us >= 990_000, "the first second to be sent or lost")
    for _ in range(60):  # and then no more than the ring holds
        now_s += 0.02
        eventually(lambda: device.sent_us >= 1e6 * now_s - 10_000, "what has come to be sent")  # noqa: B023
    device.unplugged = True  # this clock stands still, and a reader would wait for ever
    (take,) = recorder.stop()
    assert take.packets_dropped >= 900 and take.gaps >= 1
    summary = import_recording(ImportOrder([take.path]), out)
    kept = summary.events["camera"]
    assert kept + library.opened[0].events_dropped + take.events_left_out == 200_000
    with open_recording(out) as recording:
        seen = recording.cameras["camera"].slice(0, 3_000_000)
    known = Pixels().slice(0, 2_000_000)
    of_place = {(x, y): t for t, x, y in zip(known.t_us, known.x_px, known.y_px, strict=True)}
    apart = [of_place[x, y] - t for t, x, y in zip(seen.t_us, seen.x_px, seen.y_px, strict=True)]
    assert kept > 50_000 and np.ptp(apart) == 0, "all on one clock: the recording's, which begins with its first event"


def test_what_a_kill_leaves_opens(tmp_path):
    """The files as they are while it records, cut at any byte."""
    out = tmp_path / "take.h5"
    recorder, _ = recorder_of({"only": Replayed(stream=Pixels(), duration_us=LONG_US)}, out)
    path = raw_path(out, "only")
    eventually(lambda: path.stat().st_size > 200_000, "200 kB in the file")
    cut = path.read_bytes()[:-1]
    recorder.stop()
    copy = tmp_path / "cut.raw"
    copy.write_bytes(cut)
    summary = import_recording(ImportOrder([copy]), out)
    assert summary.events["camera"] > 20_000


def test_a_full_disk_is_one_line_and_what_there_is_stays(tmp_path, monkeypatch):
    out = tmp_path / "take.h5"
    recorder, _ = recorder_of({"only": Replayed(stream=Pixels(), duration_us=LONG_US)}, out)
    eventually(lambda: recorder.bytes_written > 50_000, "50 kB to be written")

    class Full:
        def __init__(self, file):
            self._file = file

        def write(self, data: bytes) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

        def __getattr__(self, name: str):
            return getattr(self._file, name)

    recorder._files[0]._file = Full(recorder._files[0]._file)
    eventually(lambda: recorder.over, "the recorder to end")
    (take,) = recorder.stop()
    assert "No space left on device" in take.problem and "free some space" in take.problem and "\n" not in take.problem
    assert import_recording(ImportOrder([take.path]), out).events["camera"] > 1000


def test_files_of_an_earlier_take_are_not_written_over(tmp_path):
    out = tmp_path / "take.h5"
    raw_path(out, "only").write_bytes(b"precious")
    with pytest.raises(RecordingError, match=r"the file exists.*rallyscope import"):
        recorder_of({"only": Replayed(stream=Pixels(), duration_us=LONG_US)}, out)
    assert raw_path(out, "only").read_bytes() == b"precious"


def test_a_camera_that_goes_ends_its_file_and_says_why(tmp_path):
    recorder, library = recorder_of({"only": Replayed(stream=Pixels(), duration_us=LONG_US)}, tmp_path / "a.h5")
    eventually(lambda: recorder.bytes_written > 20_000, "20 kB to be written")
    library.opened[0].unplugged = True
    eventually(lambda: recorder.over, "the recorder to end")
    assert recorder.error is None
    (take,) = recorder.stop()
    assert "the device was disconnected" in take.problem
    assert import_recording(ImportOrder([take.path]), tmp_path / "a.h5").events["camera"] > 5000


def test_the_time_at_the_end_of_bytes_is_the_decoders_over_every_wrap():
    encoder, clock = Evt3Encoder(), Evt3Clock()
    rng = np.random.default_rng(3)
    t_us = np.sort(rng.integers(0, 60_000_000, 20_000))
    events = Events.from_columns(t_us, rng.integers(0, 1280, 20_000), rng.integers(0, 720, 20_000), t_us % 2, SENSOR)
    for first in range(0, 20_000, 37):
        part = events.rows(slice(first, first + 37))
        assert clock.after(encoder.encode(part)) == part.t_us[-1]


def test_after_a_gap_events_without_a_known_place_are_left_out_and_counted():
    events = Pixels().slice(0, 40_000)
    words = Evt3Encoder().encode(events)
    for cut in (1, 100, 3000):
        mender = GapResynchroniser()
        mender.begin_gap()
        kept = np.concatenate([mender.fix(words[cut : cut + 50]), mender.fix(words[cut + 50 :])])
        assert count_events(kept) + mender.events_left_out == count_events(words[cut:])
        first_event = np.flatnonzero(kept >> 12 == 2)[0]
        assert {8, 0} <= set((kept[:first_event] >> 12).tolist())


def test_vectors_are_counted_by_their_bits():
    assert count_events(np.array([0x3005, 0x4FFF, 0x5FFF, 0x40A0, 0x2005, 0x8001], np.uint16)) == 12 + 8 + 2 + 1


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a,b\n1,2\n",
        "stamp_us,shift_us\n7\n",
        "stamp_us,shift_us\n1,x\n",
        "stamp_us,shift_us\n5,1\n4,1\n",
        "stamp_us,shift_us\n0,0\n9,9\n",
    ],
)
def test_a_table_of_clocks_that_is_none_is_refused(tmp_path, text):
    path = tmp_path / "clock.csv"
    path.write_text(text)
    with pytest.raises(RecordingError):
        read_clock_table(path)


def test_a_table_of_clocks_that_was_cut_short_is_read_to_there(tmp_path):
    path = tmp_path / "clock.csv"
    path.write_text("stamp_us,shift_us\n1000000,-500\n2000000,-400\n3000000,-3")
    table = read_clock_table(path)
    assert table.stamp_us.tolist() == [1_000_000, 2_000_000]
    assert table.shifted(np.array([0, 1_500_000, 9_000_000])).tolist() == [-500, 1_499_550, 8_999_600]
