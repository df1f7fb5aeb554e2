"""What every reader has to keep to, whatever the format."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from core.errors import RecordingError
from core.events import Events, SensorSize, concatenate_events
from core.recordings import RecordingWriter, open_recording

COLUMNS = ("t_us", "x_px", "y_px", "on")


@pytest.fixture
def opened(foreign):
    name, path, events = foreign
    recording = open_recording(path)
    shifted = Events.from_columns(events.t_us - events.t_us[0], events.x_px, events.y_px, events.on, events.sensor)
    yield name, recording, shifted
    recording.close()


def assert_same(found: Events, expected: Events) -> None:
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(found, column), getattr(expected, column), err_msg=column)
    assert found.sensor == expected.sensor


def test_every_format_gives_the_events_that_were_written_from_time_zero(opened):
    _, recording, events = opened
    (camera,) = recording.cameras.values()
    assert camera.event_count == len(events)
    assert recording.duration_us == events.t_us[-1] + 1
    assert_same(camera.slice(0, recording.duration_us), events)
    assert camera.t_offset_us == 7_000_000


def test_slices_cut_anywhere_add_up_and_hold_what_a_mask_holds(opened):
    _, recording, events = opened
    (camera,) = recording.cameras.values()
    rng = np.random.default_rng(1)
    cuts = np.sort(rng.integers(0, recording.duration_us, 12))
    edges = [-5, *cuts.tolist(), recording.duration_us + 7]
    parts = [camera.slice(start, end) for start, end in itertools.pairwise(edges)]
    assert_same(concatenate_events(parts, camera.sensor), events)
    for start, end in rng.integers(0, recording.duration_us, (20, 2)).tolist():
        mask = (events.t_us >= start) & (events.t_us < end)
        np.testing.assert_array_equal(camera.slice(start, end).x_px, events.x_px[mask])


def test_slices_outside_or_of_no_length_are_empty(opened):
    _, recording, _ = opened
    (camera,) = recording.cameras.values()
    end = recording.duration_us
    for first, last in ((-100, 0), (end, end + 1000), (5000, 5000), (9000, 2000), (10**15, 10**16), (-(10**15), -1)):
        assert len(camera.slice(first, last)) == 0
    assert len(camera.slice(-(10**15), 10**15)) == camera.event_count


def test_counts_per_millisecond_are_those_of_the_events(opened):
    _, recording, events = opened
    (camera,) = recording.cameras.values()
    expected = np.bincount(events.t_us // 1000, minlength=-(-recording.duration_us // 1000))
    np.testing.assert_array_equal(camera.counts_per_ms(), expected)


def test_nothing_that_is_returned_can_be_written_to(opened):
    _, recording, _ = opened
    (camera,) = recording.cameras.values()
    for events in (camera.slice(0, 1000), camera.slice(0, recording.duration_us), camera.slice(0, 0)):
        for column in COLUMNS:
            assert not getattr(events, column).flags.writeable
    assert not camera.counts_per_ms().flags.writeable
    assert not camera.triggers.t_us.flags.writeable


def test_a_file_keeps_its_identity_and_leaves_nothing_behind(foreign, tmp_path, monkeypatch):
    _, path, _ = foreign
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    first = open_recording(path)
    second = open_recording(path)
    assert first.uuid == second.uuid
    assert len(list(folder.iterdir())) == 2
    first.close()
    second.close()
    second.close()
    assert list(folder.iterdir()) == []
    with pytest.raises(RecordingError, match="closed"):
        next(iter(first.cameras.values())).slice(0, 1000)


def test_many_threads_slice_at_once(tmp_path, make_events):
    sensor = SensorSize(1280, 720)
    events = make_events(400_000, seed=3, duration_us=1_000_000, sensor=sensor)
    with RecordingWriter(tmp_path / "a.h5", {"left": sensor}) as writer:
        writer.append("left", events)
    recording = open_recording(tmp_path / "a.h5")
    camera = recording.cameras["left"]

    def check(seed: int) -> None:
        rng = np.random.default_rng(seed)
        for start in rng.integers(0, 1_000_000, 40).tolist():
            assert_same(camera.slice(start, start + 20_000), events.between(start, start + 20_000))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(check, range(16)))
    recording.close()


def test_a_slice_longer_than_the_cache_is_whole(tmp_path, make_events):
    sensor = SensorSize(64, 48)
    events = make_events(2_500_000, seed=3, duration_us=1_000_000, sensor=sensor)
    with RecordingWriter(tmp_path / "a.h5", {"left": sensor}) as writer:
        writer.append("left", events)
    with open_recording(tmp_path / "a.h5") as recording:
        camera = recording.cameras["left"]
        assert_same(camera.slice(0, 1_000_000), events)
        assert_same(camera.slice(1234, 987_654), events.between(1234, 987_654))
