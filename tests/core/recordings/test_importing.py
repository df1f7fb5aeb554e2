"""Imports: one source, two on one clock, cancelled, killed, with calibration and with pictures."""

from __future__ import annotations

import subprocess
import sys

import cv2
import h5py
import numpy as np
import pytest

from core.cameras import Camera
from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import ImportOrder, RecordingWriter, import_recording, open_recording
from core.recordings.frame_import import FrameInput, read_frame_times

SENSOR = SensorSize(346, 260)


@pytest.fixture
def pair(tmp_path, make_events, write_foreign):
    """Two event files on one clock: the second begins 500 us after the first."""
    left = make_events(20_000, seed=1, duration_us=200_000, sensor=SENSOR, start_us=7_000_000)
    right = make_events(10_000, seed=2, duration_us=200_000, sensor=SENSOR, start_us=7_000_500)
    return (
        write_foreign("evt3", tmp_path / "l", left), write_foreign("dat", tmp_path / "r", right), left, right,
    )  # fmt: skip


def test_two_sources_share_the_clock_of_the_first_event(tmp_path, pair):
    path_left, path_right, left, right = pair
    summary = import_recording(ImportOrder([path_left, path_right]), tmp_path / "a.h5")
    assert summary is not None
    assert summary.events == {"left": 20_000, "right": 10_000}
    assert summary.duration_us == 200_500
    assert summary.notes == ("Imported from l and r (Prophesee EVT3, Prophesee DAT).",)
    with open_recording(tmp_path / "a.h5") as recording:
        assert recording.notes == summary.notes
        found_left, found_right = (camera.slice(0, 10**6) for camera in recording.cameras.values())
        np.testing.assert_array_equal(found_left.t_us, left.t_us - 7_000_000)
        np.testing.assert_array_equal(found_right.t_us, right.t_us - 7_000_000)
        np.testing.assert_array_equal(found_right.x_px, right.x_px)
        assert [camera.t_offset_us for camera in recording.cameras.values()] == [7_000_000, 7_000_000]


@pytest.mark.parametrize("offset_us", [-900, 300])
def test_the_offset_is_added_to_the_clock_of_the_second_source(tmp_path, pair, offset_us):
    path_left, path_right, left, right = pair
    import_recording(ImportOrder([path_left, path_right], offset_us=offset_us, names=["a", "b"]), tmp_path / "a.h5")
    zero = min(7_000_000, 7_000_500 + offset_us)
    with open_recording(tmp_path / "a.h5") as recording:
        a, b = recording.cameras["a"], recording.cameras["b"]
        np.testing.assert_array_equal(a.slice(0, 10**6).t_us, left.t_us - zero)
        np.testing.assert_array_equal(b.slice(0, 10**6).t_us, right.t_us + offset_us - zero)
        # a camera's own time is the recording's plus its t_offset
        np.testing.assert_array_equal(b.slice(0, 10**6).t_us + b.t_offset_us, right.t_us)


def test_triggers_are_kept(tmp_path, make_events, write_foreign):
    events = make_events(3_000, seed=4, duration_us=30_000, sensor=SENSOR, start_us=7_000_000)
    path = write_foreign("evt2.1", tmp_path / "a.raw", events)  # with a trigger at its first event
    summary = import_recording(ImportOrder([path]), tmp_path / "a.h5")
    assert summary is not None and list(summary.triggers.values()) == [1]
    with open_recording(tmp_path / "a.h5") as recording:
        (camera,) = recording.cameras.values()
        assert camera.triggers.t_us.tolist() == [0] and camera.triggers.rising.tolist() == [True]


def test_real_triggers_are_kept(shared_events, tmp_path):
    path = shared_events / "walker_evt3_640x480.raw"
    summary = import_recording(ImportOrder([path, shared_events / "walker_metavision_ecf.hdf5"]), tmp_path / "a.h5")
    assert summary is not None and summary.triggers == {"left": 4157, "right": 0}
    with open_recording(tmp_path / "a.h5") as recording:
        left, right = recording.cameras.values()
        assert np.diff(left.triggers.t_us).tolist()[:3] == [500, 500, 500]
        assert left.triggers.rising[:4].tolist() == [True, False, True, False]
        a, b = left.slice(0, recording.duration_us), right.slice(0, recording.duration_us)
        for name in ("t_us", "x_px", "y_px", "on"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_importing_again_is_the_same_recording_and_importing_otherwise_is_not(tmp_path, pair):
    path_left, path_right, *_ = pair
    identities = []
    for number, (paths, offset_us) in enumerate(
        [([path_left], 0), ([path_left], 0), ([path_left, path_right], 0), ([path_left, path_right], 5)]
    ):
        import_recording(ImportOrder(paths, offset_us=offset_us), tmp_path / f"{number}.h5")
        with open_recording(tmp_path / f"{number}.h5") as recording:
            identities.append(recording.uuid)
    with open_recording(path_left) as recording:
        identities.append(recording.uuid)
    assert identities[0] == identities[1] == identities[4]
    assert len(set(identities)) == 3


def test_progress_rises_to_one_and_cancelling_leaves_no_file(tmp_path, pair):
    path_left, *_ = pair
    shares: list[float] = []
    import_recording(ImportOrder([path_left]), tmp_path / "a.h5", progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert import_recording(ImportOrder([path_left]), tmp_path / "b.h5", cancelled=lambda: True) is None
    assert not (tmp_path / "b.h5").exists()


def test_the_folder_of_the_recording_is_made(tmp_path, pair):
    path_left, *_ = pair
    assert import_recording(ImportOrder([path_left]), tmp_path / "data" / "recordings" / "a.h5") is not None
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(RecordingError, match="cannot make the folder"):
        import_recording(ImportOrder([path_left]), tmp_path / "file" / "a.h5")


def test_an_error_on_the_way_leaves_no_file(tmp_path):
    path = tmp_path / "events"
    lines = [f"{1000 * i},1,1,1\n" for i in range(150_000)]
    path.write_text("t,x,y,p\n" + "".join(lines) + "5,1,1,1\n" * 2)
    with pytest.raises(RecordingError, match="time runs"):
        import_recording(ImportOrder([path]), tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()


def test_what_makes_no_sense_is_refused_in_one_line(tmp_path, pair, write_foreign, make_events):
    path_left, path_right, *_ = pair
    target = tmp_path / "a.h5"
    late = make_events(100, seed=1, duration_us=1000, sensor=SENSOR, start_us=10**13)
    far = write_foreign("npz", tmp_path / "far", late)
    with pytest.raises(RecordingError, match="the clocks have nothing in common; got left begins at 7000000 us and"):
        import_recording(ImportOrder([path_left, far]), target)
    with pytest.raises(RecordingError, match="the names do not fit; expected 2 different ones, got a,a"):
        import_recording(ImportOrder([path_left, path_right], names=["a", "a"]), target)
    with pytest.raises(RecordingError, match="would replace its own source"):
        import_recording(ImportOrder([path_left]), path_left, overwrite=True)
    with RecordingWriter(target, {"left": SENSOR}):
        pass
    with pytest.raises(RecordingError, match="the file exists; choose another name, or --force"):
        import_recording(ImportOrder([path_left]), target)
    with pytest.raises(RecordingError, match="it is a recording already"):
        import_recording(ImportOrder([target]), tmp_path / "b.h5")
    assert import_recording(ImportOrder([path_left]), target, overwrite=True) is not None


def test_a_pair_that_does_not_overlap_is_noted(tmp_path, pair):
    path_left, path_right, *_ = pair
    summary = import_recording(ImportOrder([path_left, path_right], offset_us=900_000), tmp_path / "a.h5")
    assert summary is not None
    assert "The cameras do not overlap in time; an offset between their clocks may be missing." in summary.notes


def test_the_calibration_goes_along(tmp_path, pair):
    path_left, path_right, *_ = pair
    camera = Camera(SENSOR, np.array([[300.0, 0, 170], [0, 300, 130], [0, 0, 1]]), np.zeros(5), np.eye(4))
    import_recording(ImportOrder([path_left], calibration={"any": camera}), tmp_path / "a.h5")
    with open_recording(tmp_path / "a.h5") as recording:
        kept = recording.cameras["camera"].calibration
        assert kept is not None and kept.K[0, 0] == 300
    with pytest.raises(RecordingError, match="calibration of an unknown camera; expected left, right, got any"):
        import_recording(ImportOrder([path_left, path_right], calibration={"any": camera}), tmp_path / "b.h5")
    with pytest.raises(RecordingError, match="is for another sensor; expected 640x480, got 346x260"):
        import_recording(
            ImportOrder([path_right], sensor=SensorSize(640, 480), calibration={"any": camera}), tmp_path / "c.h5"
        )


def test_pictures_go_along_on_the_clock_of_the_events(tmp_path, pair):
    path_left, *_ = pair
    folder = tmp_path / "pictures"
    folder.mkdir()
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (3, 40, 60, 3), dtype=np.uint8)
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    times = tmp_path / "times.csv"
    times.write_text("t_us\n7010000\n7020000\n7030000\n")
    import_recording(ImportOrder([path_left], frames=FrameInput(folder, times, 4000)), tmp_path / "a.h5")
    with open_recording(tmp_path / "a.h5") as recording:
        assert list(recording.cameras) == ["camera"]
        frames = recording.frames["rgb"]
        assert frames.t_us.tolist() == [10_000, 20_000, 30_000]
        assert frames.exposure_us.tolist() == [4000] * 3
        np.testing.assert_array_equal(frames.image(1), images[1])
    times.write_text("9010000\n9020000\n9030000\n")
    late = import_recording(ImportOrder([path_left], frames=FrameInput(folder, times, 4000)), tmp_path / "late.h5")
    assert late is not None and "No picture was taken while there are events" in late.notes[-1]
    times.write_text("7010000\n7020000\n")
    with pytest.raises(RecordingError, match="frames and frame times differ in number; expected 2, got 3"):
        import_recording(ImportOrder([path_left], frames=FrameInput(folder, times, 4000)), tmp_path / "b.h5")
    times.write_text("7010000\nsoon\n")
    with pytest.raises(RecordingError, match="line 2: not a frame time; expected whole microseconds, got 'soon'"):
        import_recording(ImportOrder([path_left], frames=FrameInput(folder, times, 4000)), tmp_path / "b.h5")
    assert not (tmp_path / "b.h5").exists()


STEPWISE_IMPORT = """
import sys
from pathlib import Path
from core.recordings import ImportOrder, import_recording
import core.recordings.importing as importing
import core.recordings.sources.dat as dat
importing._FLUSH_S = 0.0
dat._BLOCK_EVENTS = 8192
def tick(share):
    print(share, flush=True)
    sys.stdin.readline()
import_recording(ImportOrder([Path(sys.argv[1])]), Path(sys.argv[2]), progress=tick)
"""


@pytest.mark.parametrize("packets", [3, 17, 30])
def test_an_import_that_is_killed_loses_nothing_that_was_flushed(tmp_path, make_events, write_foreign, packets):
    events = make_events(600_000, seed=3, duration_us=900_000, sensor=SENSOR)
    source = write_foreign("dat", tmp_path / "events", events)
    target = tmp_path / "a.h5"
    process = subprocess.Popen(
        [sys.executable, "-c", STEPWISE_IMPORT, str(source), str(target)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None and process.stdout is not None
    said = []
    for _ in range(packets):
        said.append(process.stdout.readline())
        process.stdin.write("\n")
        process.stdin.flush()
    assert process.poll() is None
    process.kill()  # at its work on the packet after these
    said += process.stdout.readlines()
    process.wait()
    with open_recording(target) as recording:
        camera = recording.cameras["camera"]
        flushed = min(8192 * len(said), len(events))  # a block or more, flushed before its progress
        assert camera.event_count >= flushed
        found = camera.slice(0, 10**6)
        np.testing.assert_array_equal(found.t_us, events.t_us[: len(found)])
    with h5py.File(target) as file:
        assert "cameras/camera/events/t" in file


def test_a_calibration_of_other_names_is_refused_with_the_names_to_give(tmp_path, pair):
    path_left, path_right, *_ = pair
    camera = Camera(SENSOR, np.array([[300.0, 0, 170], [0, 300, 130], [0, 0, 1]]), np.zeros(5), np.eye(4))
    both = {"cam0": camera, "cam1": camera}
    with pytest.raises(RecordingError, match=r"got cam0, cam1; --names cam0,cam1 if they are the same"):
        import_recording(ImportOrder([path_left, path_right], calibration=both), tmp_path / "a.h5")
    summary = import_recording(
        ImportOrder([path_left, path_right], calibration={"right": camera, "top": camera}), tmp_path / "a.h5"
    )
    assert summary is not None
    assert "The calibration of top is left out: there is no such camera." in summary.notes
    assert "The calibration has no camera left." in summary.notes


@pytest.mark.parametrize(
    ("size", "said"), [((260, 346), "exchanged"), ((692, 520), "2 times as large"), ((320, 260), "own size")]
)
def test_a_calibration_of_another_size_is_refused_with_the_likely_cause(tmp_path, pair, size, said):
    camera = Camera(SensorSize(*size), np.array([[300.0, 0, 100], [0, 300, 100], [0, 0, 1]]), np.zeros(5), np.eye(4))
    with pytest.raises(RecordingError, match=said):
        import_recording(ImportOrder([pair[0]], calibration={"any": camera}), tmp_path / "a.h5")


def test_files_of_a_pair_that_are_called_as_the_other_camera_are_said(tmp_path, pair):
    paths = [tmp_path / "my_right.raw", tmp_path / "my_left.raw"]
    for path, source in zip(paths, pair[:2], strict=True):
        path.write_bytes(source.read_bytes())
    summary = import_recording(ImportOrder(paths), tmp_path / "a.h5")
    assert summary is not None and "they may be exchanged" in summary.notes[0]
    summary = import_recording(ImportOrder(paths[::-1]), tmp_path / "b.h5")
    assert summary is not None and "exchanged" not in " ".join(summary.notes)


@pytest.mark.parametrize(
    ("text", "times_us"),
    [
        ("1000\n2000\n", [1000, 2000]),
        ("Zeit\n1000,\n2000,\n", [1000, 2000]),
        ("frame,t_us\n0,1000\n1,2000\n", [1000, 2000]),
        ("t_ms;name\n1.5;a.png\n20;b.png\n", [1500, 20_000]),
        ("timestamp [s]\n0.25\n1.7e9\n", [250_000, 1_700_000_000_000_000]),
        ("t_ns\n2500\n", [2]),
    ],
)
def test_a_heading_names_the_column_and_the_unit_of_the_frame_times(tmp_path, text, times_us):
    (tmp_path / "times.csv").write_text(text)
    assert read_frame_times(tmp_path / "times.csv").tolist() == times_us


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,1000\n1,2000\n", "which column has the frame times cannot be told.*got 0,1000"),
        ("frame,when\n0,1000\n", "which column.*got frame,when"),
        ("t_us,t_s\n1000,0.001\n", "which column"),
        ("frame,t_ms\n0,1\n1\n", "line 3: not a frame time; expected milliseconds, got ''"),
        ("t_s\ninf\n", "line 2: not a frame time"),
        ("t_us\n1000.5\n", "line 2: not a frame time; expected whole microseconds"),
    ],
)
def test_frame_times_that_cannot_be_told_are_refused(tmp_path, text, said):
    (tmp_path / "times.csv").write_text(text)
    with pytest.raises(RecordingError, match=said):
        read_frame_times(tmp_path / "times.csv")


@pytest.mark.parametrize("factor", [1000, 1_000_000])
def test_two_tables_in_different_units_are_refused_where_one_of_them_is_assumed(tmp_path, factor):
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path, scale in zip(paths, (1, factor), strict=True):
        rows = "".join(f"{7 * scale * k + 11},{k % 300},{k % 200},{k % 2}\n" for k in range(3000))
        path.write_text(f"t,x,y,p\n{rows}")
    with pytest.raises(RecordingError, match=f"about {factor:,} times those of the other.*one for each source"):
        import_recording(ImportOrder(paths, sensor=SENSOR), tmp_path / "a.h5")
    assert not (tmp_path / "a.h5").exists()
