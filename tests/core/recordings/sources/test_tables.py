"""Tables of events: HDF5 layouts, NumPy files and text, in the spellings that are about."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport
from core.recordings.sources.table_columns import counts_seconds, times_us
from core.recordings.sources.table_order import guess_columns

T = np.array([5, 5, 9, 1_500_000])
X = np.array([0, 319, 3, 100])
Y = np.array([239, 0, 7, 50])
P = np.array([1, 0, 0, 1])


def read_all(path, sensor=None):
    sources = open_sources(path, sensor)
    report = DecodeReport()
    return concatenate_events(list(sources[0].read(report)), sources[0].sensor), report, sources


def assert_the_four_events(path, sensor="320x240"):
    events, report, sources = read_all(path)
    assert events.t_us.tolist() == T.tolist()
    assert events.x_px.tolist() == X.tolist()
    assert events.y_px.tolist() == Y.tolist()
    assert events.on.tolist() == (P == 1).tolist()
    assert str(sources[0].sensor) == sensor
    return report


@pytest.mark.parametrize(
    "text",
    [
        "t,x,y,p\n5,0,239,1\n5,319,0,0\n9,3,7,0\n1500000,100,50,1\n",
        "x;y;polarity;timestamp\n0;239;1;5\n319;0;0;5\n3;7;0;9\n100;50;1;1500000",
        "# made by hand\nt_s x y on\n0.000005 0 239 1\n0.000005 319 0 -1\n0.000009 3 7 -1\n1.5 100 50 1\n",
        "timestamp [us], x [px], y [px], p\n5, 0, 239, 1\n5, 319, 0, 0\n9, 3, 7, 0\n1500000, 100, 50, 1\n".replace(
            " [px]", ""
        ),
        "5 0 239 1\n5 319 0 0\n9 3 7 0\n1500000 100 50 1\n",
        "0,239,1,5\n319,0,0,5\n3,7,0,9\n100,50,1,1500000\n",
        "0\t239\t5\t1\n319\t0\t5\t-1\n3\t7\t9\t-1\n100\t50\t1500000\t1\n",
        "0.000005 0 239 1\n0.000005 319 0 0\n0.000009 3 7 0\n1.500000 100 50 1\n",
        "index,t,x,y,p\n1,5,0,239,1\n2,5,319,0,0\n3,9,3,7,0\n\n4,1500000,100,50,1\n",
    ],
)
def test_text_in_the_usual_spellings(tmp_path, text):
    path = tmp_path / "events"
    path.write_text(text)
    report = assert_the_four_events(path)
    assert report.notes == ["events does not name its sensor size; 320x240 is assumed from the events."]


def test_a_line_that_is_no_event_ends_the_text(tmp_path):
    path = tmp_path / "events"
    path.write_text("t,x,y,p\n5,0,239,1\n6,1,1,1\n7,1,one,0\n8,1,1,1\n")
    events, report, _ = read_all(path)
    assert len(events) == 2
    assert report.notes[-1] == "events: stopped at line 4: '7,1,one,0' is not an event."


def test_tables_that_are_not_sorted_or_leave_the_sensor_are_refused(tmp_path):
    path = tmp_path / "events"
    path.write_text("t,x,y,p\n5000,0,0,1\n6000,1,1,1\n4000,1,1,0\n")
    with pytest.raises(
        RecordingError, match="event 2 cannot be used: time runs 2,000 us back; sort the events by time"
    ):
        read_all(path)
    path.write_text("t,x,y,p\n5000,0,0,1\n6000,1,1,1\n")
    with pytest.raises(RecordingError, match="column 1 outside the 1x5 sensor; check the sensor size"):
        read_all(path, SensorSize(1, 5))


def test_a_little_disorder_is_put_right_and_noted(tmp_path):
    path = tmp_path / "events"
    path.write_text("t,x,y,p\n5000,0,0,1\n6000,1,1,1\n5900,1,1,0\n6100,1,1,0\n")
    events, report, _ = read_all(path)
    assert events.t_us.tolist() == [5000, 6000, 6000, 6100]
    assert report.notes[-1] == "events: 1 events came up to 1 ms too early; they have the time before them."


@pytest.mark.parametrize("form", ["columns", "other names", "records", "rows", "npy"])
def test_numpy_files_in_the_usual_forms(tmp_path, form):
    path = tmp_path / "events"
    records = np.zeros(4, [("x", "u2"), ("y", "u2"), ("p", "?"), ("t", "i8")])
    records["x"], records["y"], records["p"], records["t"] = X, Y, P, T
    with path.open("wb") as file:
        match form:
            case "columns":
                np.savez_compressed(file, t=T, x=X, y=Y, p=P, width=np.array(320), height=np.array(240))
            case "other names":
                np.savez(file, timestamps=T / 1e6, x_pos=X, y_pos=Y, polarities=P * 2 - 1)
            case "records":
                np.savez(file, events=records)
            case "rows":
                np.savez(file, np.stack([T, X, Y, P], axis=1).astype(float))
            case "npy":
                np.save(file, records)
    report = assert_the_four_events(path)
    assert len(report.notes) == (0 if form == "columns" else 1)


def test_numpy_files_without_events_are_refused(tmp_path):
    path = tmp_path / "events"
    for content, message in (
        ({"a": T, "b": X}, "no column for t; expected one of t, ts"),
        ({"t": T, "x": X[:2], "y": Y, "p": P}, "differ in shape"),
        ({"t": np.array([5.0, np.nan, 6, 7]), "x": X, "y": Y, "p": P}, "a time is not a finite number"),
        ({"t": np.array(["a"]), "x": X[:1], "y": Y[:1], "p": P[:1]}, "cannot be read"),
    ):
        with path.open("wb") as file:
            np.savez(file, **content)
        with pytest.raises(RecordingError, match=message):
            open_sources(path)
    with path.open("wb") as file:
        np.save(file, np.zeros((3, 7)))
    with pytest.raises(RecordingError, match=r"not an array of events; expected \(N, 4\)"):
        open_sources(path)


def test_a_stereo_mvsec_file_has_two_cameras_on_one_clock(tmp_path):
    path = tmp_path / "events"
    with h5py.File(path, "w") as file:
        for side, shift in (("left", 0), ("right", 40)):
            file[f"davis/{side}/events"] = np.stack([X, Y, (T + shift) / 1e6 + 1_500_000_000, P * 2 - 1], axis=1)
    sources = open_sources(path)
    assert [source.name for source in sources] == ["left", "right"]
    times = [concatenate_events(list(source.read(DecodeReport())), source.sensor).t_us for source in sources]
    assert times[0].tolist() == (T + 1_500_000_000_000_000).tolist()
    np.testing.assert_array_equal(times[1] - times[0], 40)


def test_dsec_times_are_absolute_and_its_compression_is_read(tmp_path):
    hdf5plugin = pytest.importorskip("hdf5plugin")
    path = tmp_path / "events"
    with h5py.File(path, "w") as file:
        for name, column in (
            ("t", T.astype("u4")),
            ("x", X.astype("u2")),
            ("y", Y.astype("u2")),
            ("p", P.astype("u1")),
        ):
            file.create_dataset(f"events/{name}", data=column, chunks=(2,), **hdf5plugin.Blosc(cname="zstd"))
        file["t_offset"] = np.int64(49_599_300_523)
        file["ms_to_idx"] = np.searchsorted(T, np.arange(1501) * 1000).astype("u8")
    events, _, sources = read_all(path)
    assert events.t_us.tolist() == (T + 49_599_300_523).tolist()
    assert str(sources[0].sensor) == "640x480"
    assert sources[0].format == "DSEC HDF5"


def test_the_sensor_resolution_attribute_lists_the_height_first(tmp_path):
    path = tmp_path / "events"
    with h5py.File(path, "w") as file:
        for name, column in (("ts", T / 1e6), ("xs", X), ("ys", Y), ("ps", P.astype(bool))):
            file[f"events/{name}"] = column
        file.attrs["sensor_resolution"] = (260, 346)
    assert assert_the_four_events(path, "346x260").notes == []


def test_hdf5_files_without_events_are_refused(tmp_path):
    path = tmp_path / "events"
    with h5py.File(path, "w") as file:
        file["weights"] = T
    with pytest.raises(RecordingError, match="no events in a layout that is known; got an HDF5 file of weights"):
        open_sources(path)
    with h5py.File(path, "w") as file:
        for name, column in (("t", T), ("x", X[:2]), ("y", Y), ("p", P)):
            file[f"events/{name}"] = column
    with pytest.raises(RecordingError, match="event columns differ in length"):
        open_sources(path)


def test_units_of_time_follow_from_names_and_types():
    assert [counts_seconds(name) for name in ("t_us", "time [us]", "t_s", "time [s]", "t", "ts")] == [
        False, False, True, True, None, None,
    ]  # fmt: skip
    assert times_us(np.array([1.5, -2.0])).tolist() == [1_500_000, -2_000_000]
    assert times_us(np.array([1, 2], np.uint32)).tolist() == [1, 2]
    assert times_us(np.array([1, 2], np.uint32), seconds=True).tolist() == [1_000_000, 2_000_000]


def test_columns_that_could_be_anything_are_refused():
    with pytest.raises(RecordingError, match="the four columns are not recognised"):
        guess_columns(np.array([[1.5, 9, 7, 3], [1.2, 3, 4, 5]]), where="here")
