"""Tables of events: HDF5 layouts, NumPy files and text, in the spellings that are about."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport, FactOrigin, ImportOptions
from core.recordings.sources.table_columns import unit_of_name
from core.recordings.sources.values.stated_sizes import size_in_attributes
from core.recordings.sources.values.table_order import guess_columns

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
    assert report.notes[0] == "events does not name its sensor size; 320x240 is assumed from the events."
    said = "t_s" in text or "[us]" in text
    named = "x" in text
    order = [note for note in report.notes if "does not name its columns" in note]
    unit = [note for note in report.notes if "the unit of its times" in note]
    assert report.notes[1:] == order + unit == report.assumed[1:]
    assert (len(order), len(unit)) == (0 if named else 1, 0 if said else 1)


def test_a_line_that_is_no_event_is_left_out_and_told(tmp_path):
    path = tmp_path / "events"
    path.write_text("t,x,y,p\n5,0,239,1\n6,1,1,1\n7,1,one,0\n8,1,1,1\n")
    events, report, _ = read_all(path)
    assert events.t_us.tolist() == [5, 6, 8]
    assert "events: 1 lines are not events and were left out; first line 4: '7,1,one,0'." in report.notes
    path.write_text("t,x,y,p\n5,0,239,1\n" + "7,1,one,0\n" * 4)
    with pytest.raises(RecordingError, match="4 of 5 lines are not events; got first line 3: '7,1,one,0'"):
        read_all(path)


def test_times_that_go_back_for_good_are_refused(tmp_path):
    path = tmp_path / "events"
    t = np.concatenate([np.arange(200) * 100_000, 1_000_000 + np.arange(200) * 100_000])
    path.write_text("t_us,x,y,p\n" + "".join(f"{value},1,1,{value // 100_000 % 2}\n" for value in t))
    with pytest.raises(
        RecordingError, match=r"event 200 cannot be used: time runs 18,900,000 us back.*sort the events"
    ):
        read_all(path)


def test_a_sensor_size_that_many_events_leave_is_refused_with_one_that_holds_them(tmp_path):
    path = tmp_path / "events"
    path.write_text("t,x,y,p\n" + "".join(f"{5000 + i},{i % 9},{i % 7},1\n" for i in range(200)))
    with pytest.raises(RecordingError, match="events lie outside the 8x5 sensor; expected a sensor of at least 9x7"):
        read_all(path, SensorSize(8, 5))


def test_one_address_outside_is_left_out_and_counted(tmp_path):
    path = tmp_path / "events"
    path.write_text("t_us,x,y,p\n" + "".join(f"{i},1,{33014 if i == 70 else 1},{i % 2}\n" for i in range(200)))
    events, report, sources = read_all(path, SensorSize(10, 10))
    assert len(events) == 199 and 70 not in events.t_us
    assert report.notes == ["events: 1 events outside the 10x10 sensor were left out (addresses up to 1, 33014)."]
    assert str(open_sources(path)[0].sensor) == "128x128"  # nor does it make the sensor larger
    assert sources[0].sensor_from == FactOrigin.OPTION


def test_rows_out_of_order_are_sorted_and_noted(tmp_path):
    path = tmp_path / "events"
    path.write_text("t_us,x,y,p\n5000,0,0,1\n6000,1,1,1\n4000,2,1,0\n6100,3,1,0\n")
    events, report, _ = read_all(path)
    assert events.t_us.tolist() == [4000, 5000, 6000, 6100] and events.x_px.tolist() == [2, 0, 1, 3]
    assert report.notes[-1] == "events: 1 events were out of order by up to 2 ms; now sorted."


def test_rows_of_several_parts_are_sorted_together(tmp_path):
    rng = np.random.default_rng(4)
    t = np.arange(300_000) * 10 + rng.integers(0, 400_000, 300_000)
    path = tmp_path / "events"
    with path.open("wb") as file:
        np.savez(file, t_us=t, x=t % 640, y=t % 480, p=t % 2, width=640, height=480)
    events, report, _ = read_all(path)
    np.testing.assert_array_equal(events.t_us, np.sort(t))
    np.testing.assert_array_equal(events.x_px, np.sort(t) % 640)
    assert len(report.notes) == 1 and "now sorted" in report.notes[0]


def test_a_few_wrong_times_are_left_out_wherever_they_stand(tmp_path):
    t = 10_000_000 + np.arange(3000) * 100
    wrong = [0, 700, 1500, 1501, 2999]
    t[wrong] = [900_000_000, 5, 500_000_000, 500_000_001, 3]
    path = tmp_path / "events"
    with path.open("wb") as file:
        np.savez(file, t_us=t, x=t % 64, y=t % 48, p=np.arange(3000) % 2, width=64, height=48)
    events, report, _ = read_all(path)
    np.testing.assert_array_equal(events.t_us, np.delete(t, wrong))
    assert report.notes == ["events: 5 events were left out: their times lie apart from the others."]


@pytest.mark.parametrize("bits", [24, 32])
def test_a_clock_that_begins_again_runs_on(tmp_path, bits):
    true = (1 << bits) - 150_000 + np.arange(3000) * 100
    path = tmp_path / "events"
    with path.open("wb") as file:
        t = true % (1 << bits)
        np.savez(file, t_us=t, x=t % 64, y=t % 48, p=np.arange(3000) % 2, width=64, height=48)
    events, report, _ = read_all(path)
    np.testing.assert_array_equal(events.t_us, true)
    assert report.notes == ["events: the clock began again at 0 1 times; its time runs on."]


@pytest.mark.parametrize(
    ("values", "dtype", "on"),
    [
        ((0, 1), "i8", 1), ((-1, 1), "i8", 1), ((0, 255), "u1", 255), ((255, 1), "u1", 1), ((65535, 1), "u2", 1),
        ((2**32 - 1, 1), "u4", 1), ((2**64 - 1, 1), "u8", 1), ((-1.0, 1.0), "f8", 1), ((False, True), "?", True),
        (("off", "on"), "U3", "on"), (("False", "True"), "U5", "True"), ((b"-", b"+"), "S1", b"+"),
    ],
)  # fmt: skip
def test_pairs_of_polarities_are_told_apart(tmp_path, values, dtype, on):
    k = np.arange(400)
    p = np.array(values, dtype)[(k % 3 == 0).astype(int)]
    path = tmp_path / "events"
    with path.open("wb") as file:
        np.savez(file, t_us=k, x=k % 64, y=k % 48, p=p, width=64, height=48)
    events, report, _ = read_all(path)
    np.testing.assert_array_equal(events.on, p == on)
    assert any("polarities are read as" in note for note in report.notes) == (dtype[0] == "u")


def test_polarities_that_cannot_be_told_are_asked_for(tmp_path):
    k = np.arange(400)
    path = tmp_path / "events"
    with path.open("wb") as file:
        np.savez(file, t_us=k, x=k % 64, y=k % 48, p=1 + k % 2, width=64, height=48)
    with pytest.raises(RecordingError, match=r"which polarity is ON cannot be told.*got 1, 2; give --polarity"):
        read_all(path)
    (source,) = open_sources(path)
    report = DecodeReport(options=ImportOptions(polarity={"1": True, "2": False}))
    events = concatenate_events(list(source.read(report)), source.sensor)
    np.testing.assert_array_equal(events.on, k % 2 == 0)


@pytest.mark.parametrize(
    ("t", "unit", "first_us", "last_us"),
    [
        (1_700_000_000_000_000_000 + np.arange(500) * 1_000_000, None, 1_700_000_000_000_000, 1_700_000_000_499_000),
        (1_700_000_000.0 + np.arange(500) / 1024, None, 1_700_000_000_000_000, None),
        (np.arange(500) * 1000, "ns", 0, 499),
        (np.arange(500), "ms", 0, 499_000),
        (np.arange(500) * 0.5, "ms", 0, 249_500),
    ],
)
def test_units_are_told_by_the_values_or_stated(tmp_path, t, unit, first_us, last_us):
    k = np.arange(500)
    path = tmp_path / "events"
    with path.open("wb") as file:
        np.savez(file, t=t, x=k % 64, y=k % 48, p=k % 2, width=64, height=48)
    (source,) = open_sources(path)
    report = DecodeReport(options=ImportOptions(time_unit=unit))
    events = concatenate_events(list(source.read(report)), source.sensor)
    assert events.t_us[0] == first_us and last_us in (None, events.t_us[-1])
    assert len(report.notes) == (1 if unit is None else 0)


def test_times_that_could_be_nanoseconds_are_asked_for(tmp_path):
    k = np.arange(500)
    path = tmp_path / "events"
    with path.open("wb") as file:
        np.savez(file, t=k * 1_000_000, x=k % 64, y=k % 48, p=k % 2, width=64, height=48)
    with pytest.raises(RecordingError, match=r"unit of the times cannot be told.*give --time-unit ns"):
        read_all(path)


@pytest.mark.parametrize(
    "text",
    [
        "\ufefft_us,x,y,p\r\n5,0,239,1\r\n5,319,0,0\r\n9,3,7,0\r\n1500000,100,50,1\r\n",
        '"t_us","x","y","p"\n"5","0","239","1"\n"5","319","0","0"\n"9","3","7","0"\n"1500000","100","50","1"\n',
        "t_us;x;y;p\n5,0;0;239;True\n5,0;319;0;False\n9,0;3;7;False\n1500000,0;100;50;True\n",
        "0,000005 0 239 1\n0,000005 319 0 0\n0,000009 3 7 0\n1,500000 100 50 1\n",
    ],
)
def test_text_of_other_programs_and_countries(tmp_path, text):
    path = tmp_path / "events"
    for encoding in ("utf-8", "utf-16"):
        path.write_bytes(text.removeprefix("\ufeff" if encoding == "utf-16" else "").encode(encoding))
        assert_the_four_events(path)


@pytest.mark.parametrize(
    "head", ["%geometry:1280,720\n", "# width: 1280, height: 720\n", "1280 720\n", "# sensor size 1280x720\n"]
)
def test_sizes_in_headers_of_text(tmp_path, head):
    path = tmp_path / "events"
    path.write_text(head + "0.000005 0 239 1\n0.000005 319 0 0\n0.000009 3 7 0\n1.500000 100 50 1\n")
    report = assert_the_four_events(path, "1280x720")
    assert not any("sensor size" in note for note in report.notes)


@pytest.mark.parametrize(
    "attributes",
    [
        {"geometry": np.bytes_(b"1280x720")},
        {"width": "1280", "height": np.bytes_(b"720")},
        {"resolution": np.array([1280, 720])},
        {"sensor_resolution": (720, 1280)},
    ],
)
def test_sizes_in_attributes_as_numbers_text_or_bytes(attributes):
    assert size_in_attributes(attributes, (319, 239)) == SensorSize(1280, 720)


def test_a_sensor_that_stands_upright_is_told_by_its_events():
    assert size_in_attributes({"sensor_resolution": (1280, 720)}, (700, 1200)) == SensorSize(720, 1280)
    assert size_in_attributes({"sensor_resolution": (1280, 720)}, (1200, 700)) == SensorSize(1280, 720)


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
    assert len(report.notes) == {"columns": 1, "rows": 3}.get(form, 2)
    assert any("taken for t, x, y, p" in note for note in report.notes) == (form == "rows")
    assert any("the unit of its times" in note for note in report.notes)


def test_numpy_files_without_events_are_refused(tmp_path):
    path = tmp_path / "events"
    for content, message in (
        ({"a": T, "b": X}, "no column for t; expected one of t, ts"),
        ({"t": T, "x": X[:2], "y": Y, "p": P}, "differ in shape"),
        ({"t": np.full(4, np.nan), "x": X, "y": Y, "p": P}, "4 of 4 events have a time or a polarity that is none"),
        ({"t": np.array(["a"]), "x": X[:1], "y": Y[:1], "p": P[:1]}, "cannot be read"),
    ):
        with path.open("wb") as file:
            np.savez(file, **content)
        with pytest.raises(RecordingError, match=message):
            read_all(path)
    with path.open("wb") as file:
        np.save(file, np.zeros((3, 7)))
    with pytest.raises(RecordingError, match=r"not an array of events; expected \(N, 4\)"):
        open_sources(path)


def test_a_table_without_rows_and_a_pickled_array_are_refused_as_that(tmp_path):
    np.save(tmp_path / "empty.npy", np.zeros((0, 4)))
    with pytest.raises(RecordingError, match="the table has no rows"):
        open_sources(tmp_path / "empty.npy")
    np.save(tmp_path / "pickled.npy", np.array([{"t": 1}], object), allow_pickle=True)
    with pytest.raises(RecordingError, match="a pickled file is not opened"):
        open_sources(tmp_path / "pickled.npy")


@pytest.mark.parametrize(("size", "asks"), [((320, 240), True), ((321, 240), False), ((319, 240), False)])
def test_addresses_that_fill_a_usual_sensor_if_they_count_from_1_are_asked_about(tmp_path, size, asks):
    t, corners = np.arange(4), np.array([[1, 1], [size[0], 1], [1, size[1]], size])
    np.savez(tmp_path / "a.npz", t=t, x=corners[:, 0], y=corners[:, 1], p=t % 2)
    (source,) = open_sources(tmp_path / "a.npz")
    report = DecodeReport()
    list(source.read(report))
    said = [note for note in report.assumed if "they may count from 1: then they are those of a 320x240 sensor" in note]
    assert len(said) == asks


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
    assert assert_the_four_events(path, "346x260").notes[1:] == []


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


def test_units_of_time_follow_from_names():
    names = ("t_us", "time [us]", "t [\u00b5s]", "t_s", "time(ns)", "t_ms", "t", "ts", "polarity_s_x")
    assert [unit_of_name(name) for name in names] == ["us", "us", "us", "s", "ns", "ms", None, None, None]


def test_columns_that_could_be_anything_are_refused():
    with pytest.raises(RecordingError, match="the four columns are not recognised"):
        guess_columns(np.array([[1.5, 9, 7, 3], [1.2, 3, 4, 5]]), where="here")
