"""Writing and reading a recording gives back what was written."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.cameras import Camera
from core.errors import RecordingError
from core.events import Events, SensorSize
from core.recordings import BallTruth, PixelTruth, RecordingWriter, Triggers, open_recording
from core.recordings.blocks import CHUNK_EVENTS

SENSOR = SensorSize(320, 240)


def assert_same_events(found: Events, expected: Events) -> None:
    for name in ("t_us", "x_px", "y_px", "on"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    assert found.sensor == expected.sensor


def some_camera(sensor: SensorSize) -> Camera:
    T = np.eye(4)
    T[:3, 3] = (0.1, 0.2, 0.3)
    return Camera(sensor, np.array([[300.0, 0, 160], [0, 301, 120], [0, 0, 1]]), np.array([0.1, 0.01, 0, 0, 0.2]), T)


@pytest.mark.parametrize("count", [0, 1, CHUNK_EVENTS - 1, CHUNK_EVENTS, CHUNK_EVENTS + 1, 3 * CHUNK_EVENTS + 77])
def test_what_is_read_is_what_was_written_in_pieces_of_any_size(tmp_path, make_events, count):
    events = make_events(count, seed=count, duration_us=5_000_000, sensor=SENSOR)
    rng = np.random.default_rng(count)
    cuts = np.sort(rng.integers(0, count + 1, 20))
    with RecordingWriter(tmp_path / "a.h5", {"left": SENSOR}) as writer:
        for number, part in enumerate(np.split(np.arange(count), cuts)):
            writer.append("left", events.rows(part))
            if number % 5 == 0:
                writer.flush()
        assert writer.event_count("left") == count
    recording = open_recording(tmp_path / "a.h5")
    camera = recording.cameras["left"]
    assert camera.event_count == count
    assert recording.duration_us == (5_000_000 if count else 0)
    assert_same_events(camera.slice(0, recording.duration_us), events)
    recording.close()


def test_a_closed_recording_is_plain_hdf5_that_h5py_reads_with_its_own_filters(tmp_path, make_events):
    events = make_events(70_000, seed=1, duration_us=400_000, sensor=SENSOR)
    with RecordingWriter(tmp_path / "a.h5", {"left": SENSOR}, seed=7, config={"noise_hz": 0.5}) as writer:
        writer.append("left", events)
    with h5py.File(tmp_path / "a.h5") as file:
        group = file["cameras/left"]
        assert dict(group.attrs) == {"width": 320, "height": 240}
        for name, values, dtype in (
            ("t", events.t_us, np.int64),
            ("x", events.x_px, np.uint16),
            ("y", events.y_px, np.uint16),
            ("p", events.on, np.uint8),
        ):
            column = group["events"][name]
            assert column.dtype == dtype and column.compression == "gzip" and column.shuffle
            np.testing.assert_array_equal(column[()], values)
        expected = np.searchsorted(events.t_us, np.arange(400) * 1000)
        np.testing.assert_array_equal(group["ms_to_idx"][()], expected)
        assert file.attrs["format"] == "rallyscope-recording"
        assert file.attrs["seed"] == 7
        assert file.attrs["config"] == '{"noise_hz": 0.5}'


def test_truth_triggers_calibration_and_own_groups_come_back(tmp_path, make_events):
    t = np.arange(0, 9_000, 1000)
    n = len(t)
    rng = np.random.default_rng(0)
    ball = BallTruth(t, rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), t > 2000)
    pixels = PixelTruth(t, rng.normal(size=n), rng.normal(size=n), np.where(t > 2000, 5.0, np.nan), t > 2000)
    triggers = Triggers(t + 5, t % 2000 == 0, np.full(n, 6, np.int16))
    with RecordingWriter(
        tmp_path / "a.h5",
        {"left": SENSOR, "a-right_1": SENSOR},
        calibration={"left": some_camera(SENSOR)},
        time_offsets_us={"left": 7_139_845},
    ) as writer:
        writer.append("left", make_events(100, seed=1, duration_us=9_000, sensor=SENSOR))
        writer.write_ball(ball)
        writer.write_truth("left", pixels)
        for half in (slice(0, 4), slice(4, None)):
            writer.write_triggers("left", Triggers(triggers.t_us[half], triggers.rising[half], triggers.channel[half]))
            writer.append_rows("/racket", {"t_us": t[half], "q_world_wxyz": np.ones((n, 4))[half] * t[half, None]})
        writer.extend_duration(20_000)
        writer.note("a test")
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["racket/q_world_wxyz"].shape == (n, 4)
        assert file["cameras/left/t_offset"][()] == 7_139_845
        assert file["cameras/left/calibration/K"][1, 1] == 301
    recording = open_recording(tmp_path / "a.h5")
    assert list(recording.cameras) == ["left", "a-right_1"]
    assert recording.duration_us == 20_000
    assert recording.notes == ("a test",)
    left, right = recording.cameras.values()
    assert right.event_count == 0 and right.truth is None and right.calibration is None and not len(right.triggers.t_us)
    assert len(right.counts_per_ms()) == len(left.counts_per_ms()) == 20
    for name in ("t_us", "p_world_m", "v_world_mps", "spin_radps", "visible"):
        np.testing.assert_array_equal(getattr(recording.ball, name), getattr(ball, name))
    for name in ("t_us", "u_px", "v_px", "r_px", "visible"):
        np.testing.assert_array_equal(getattr(left.truth, name), getattr(pixels, name))
    for name in ("t_us", "rising", "channel"):
        np.testing.assert_array_equal(getattr(left.triggers, name), getattr(triggers, name))
    assert left.calibration is not None
    np.testing.assert_array_equal(left.calibration.K, some_camera(SENSOR).K)
    np.testing.assert_array_equal(left.calibration.T_world_camera, some_camera(SENSOR).T_world_camera)
    recording.close()


def test_rows_larger_than_a_chunk_come_back_in_order(tmp_path):
    images = np.random.default_rng(0).integers(0, 255, (7, 300, 400, 3), dtype=np.uint8)
    with RecordingWriter(tmp_path / "a.h5", {"rgb": SENSOR}) as writer:
        for first in (0, 3):
            rows = slice(first, first + 3 if first == 0 else None)
            t_us = np.arange(7)[rows] * 10_000
            writer.write_frames("rgb", t_us, np.full(len(t_us), 500), images[rows])
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["cameras/rgb/frames/image"][()], images)
    recording = open_recording(tmp_path / "a.h5")
    frames = recording.frames["rgb"]
    assert len(frames) == 7
    np.testing.assert_array_equal(frames.image(4), images[4])
    recording.close()


def test_time_that_runs_backwards_is_refused_and_the_rest_is_kept(tmp_path, make_events):
    events = make_events(10, seed=1, duration_us=1000, sensor=SENSOR)
    with RecordingWriter(tmp_path / "a.h5", {"left": SENSOR}) as writer:
        writer.append("left", events)
        with pytest.raises(RecordingError, match="time runs backwards; expected times that never decrease, got 0 us"):
            writer.append("left", events)
    recording = open_recording(tmp_path / "a.h5")
    assert recording.cameras["left"].event_count == 10
    recording.close()


def test_wrong_names_sensors_and_files_are_refused_in_one_line(tmp_path, make_events):
    path = tmp_path / "a.h5"
    with RecordingWriter(path, {"left": SENSOR}) as writer:
        with pytest.raises(RecordingError, match="no such camera; expected left, got right"):
            writer.append("right", Events.empty(SENSOR))
        with pytest.raises(RecordingError, match="events of another sensor; expected 320x240, got 640x480"):
            writer.append("left", make_events(2, seed=0, duration_us=10, sensor=SensorSize(640, 480)))
        with pytest.raises(RecordingError, match="under 24 hours"):
            writer.append("left", make_events(2, seed=0, duration_us=10**12, sensor=SENSOR))
        with pytest.raises(RecordingError, match="columns differ in length"):
            writer.append_rows("/racket", {"t_us": np.arange(3), "x": np.arange(2)})
        with pytest.raises(RecordingError, match="being written right now"):
            open_recording(path)
    with pytest.raises(RecordingError, match="the file exists"):
        RecordingWriter(path, {"left": SENSOR})
    with pytest.raises(RecordingError, match="not a camera name"):
        RecordingWriter(tmp_path / "b.h5", {"../left": SENSOR})
    with pytest.raises(RecordingError, match="cannot create the recording"):
        RecordingWriter(tmp_path / "missing" / "b.h5", {"left": SENSOR})
    with pytest.raises(RecordingError, match="closed"):
        writer.note("too late")
    with RecordingWriter(path, {"left": SENSOR}, overwrite=True) as writer:
        writer.discard()
    assert not path.exists()
