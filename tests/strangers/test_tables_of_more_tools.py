"""More public reports about tables of events, each with a file made here: read right, or refused with the reason.

Each case says what came of it when it was first tried.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import ImportOrder, import_recording, open_recording
from core.recordings.sources.source import ImportOptions
from tests.strangers import event_files as make

VGA = make.draw_rows(640, 480, count=600)
FRAME = pd.DataFrame({"t": VGA.t, "x": VGA.x, "y": VGA.y, "p": VGA.p})
SECONDS = 1_700_000_000
SPLIT = {"ts_sec": SECONDS + VGA.t // 10**6, "ts_nsec": VGA.t % 10**6 * 1000, "x": VGA.x, "y": VGA.y, "p": VGA.p}
GITHUB = "https://github.com"
Write = Callable[[Path], Path]


def lines(form: Callable[[int, int, int, int], str], head: str = "t,x,y,p") -> Write:
    """A text with one line for each event."""
    rows = list(zip(*(column.tolist() for column in VGA), strict=True))
    return lambda path: make.write(path, "\n".join([head, *(form(*row) for row in rows), ""]).encode())


def dated(first: str, zone: str | None = None, polarity: str | None = None) -> Write:
    """A table of pandas whose times are dates."""
    start = pd.Timestamp(first) if zone is None else pd.Timestamp(first, tz="UTC").tz_convert(zone)
    times = start + pd.to_timedelta(VGA.t, unit="us")
    words = VGA.p if polarity is None else np.where(VGA.p, "ON", "OFF")
    frame = pd.DataFrame({"timestamp": times, "x": VGA.x, "y": VGA.y, "polarity": words})
    return lambda path: make.write(path, frame.to_csv(index=False).encode())


def indexed_twice(path: Path) -> Path:
    """Written, read and written again: each time with a column that counts the rows."""
    return make.write(path, pd.read_csv(io.BytesIO(FRAME.to_csv().encode())).to_csv().encode())


def feather(path: Path) -> Path:
    FRAME.to_feather(path)
    return path


def blocks(path: Path) -> Path:
    """What `to_hdf` writes: columns of one type side by side, their names elsewhere."""
    with h5py.File(path, "w") as file:
        group = file.create_group("events")
        group.attrs["pandas_type"] = b"frame"
        group["axis0"], group["block0_items"] = np.array([b"t", b"x", b"y", b"p"]), np.array([b"t", b"x", b"y", b"p"])
        group["axis1"], group["block0_values"] = np.arange(len(VGA.t)), np.stack(VGA, axis=1)
    return path


def linked(path: Path, name: str) -> Path:
    """Events of which a part is a link to a file that is gone."""
    with h5py.File(path, "w") as file:
        for column, values in VGA._asdict().items():
            file[f"events/{column}"] = values
        del file[name]
        file[name] = h5py.ExternalLink("gone.h5", name)
    return path


def records_beside_others(path: Path) -> Path:
    """Records of events, times in ms, and other arrays."""
    records = np.zeros(len(VGA.t), [("x", "<u2"), ("y", "<u2"), ("t", "<f8"), ("p", "<u1"), ("label", "<u1")])
    records["x"], records["y"], records["t"], records["p"] = VGA.x, VGA.y, VGA.t / 1000, VGA.p
    return make.npz(path, ev=records, evs_norm=np.zeros((3, 3)), ev_loc=np.zeros((3, 3)))


READ: dict[str, tuple[Write, ImportOptions]] = {
    # A column without a name, or two, that count the rows: was right.
    f"{GITHUB}/pandas-dev/pandas/issues/10646": (lambda p: make.write(p, FRAME.to_csv().encode()), ImportOptions()),
    f"{GITHUB}/pandas-dev/pandas/issues/13017": (indexed_twice, ImportOptions()),
    # The whole time twice, in seconds and in nanoseconds: was right.
    "own variation: seconds and the same in nanoseconds": (
        lines(lambda t, x, y, p: f"{t / 1e6:.6f},{t}000,{x},{y},{p}", "t_s,t_ns,x,y,p"),
        ImportOptions(),
    ),
    # Some times with an exponent: was right.
    f"{GITHUB}/pandas-dev/pandas/issues/2697": (
        lines(lambda t, x, y, p: f"{t if t % 7 else format(float(t), '.6E')},{x},{y},{p}"),
        ImportOptions(),
    ),
    # A comma at the end of each line: was right.
    f"{GITHUB}/pandas-dev/pandas/issues/27515": (lines(lambda t, x, y, p: f"{t},{x},{y},{p},"), ImportOptions()),
    # Dates, some without a fraction (whole seconds), with a zone or without: were refused, "not events".
    f"{GITHUB}/pandas-dev/pandas/issues/62111": (dated("2025-08-14 12:34:56", "UTC"), ImportOptions()),
    f"{GITHUB}/Eventual-Inc/Daft/issues/5045": (dated("2024-01-01 23:59:59.75"), ImportOptions()),
    f"{GITHUB}/NVIDIA/cudf/issues/6227": (dated("1970-01-01"), ImportOptions()),
    "own variation: a clock that is put back by an hour, and words": (
        dated("2025-10-26 00:59:59.8", "Europe/Berlin", "on"),
        ImportOptions(),
    ),
    "own variation: ISO 8601, no names": (
        lines(lambda t, x, y, p: f"{np.datetime64('2024-01-01T00:00:00', 'us') + t}Z,{x},{y},{p}", "# events"),
        ImportOptions(),
    ),
    # Thousands parted by commas: was read as a decimal comma, times a thousand times too short, and refused for that.
    f"{GITHUB}/pandas-dev/pandas/pull/65397": (lines(lambda t, x, y, p: f'"{t:,}",{x},{y},{p}'), ImportOptions()),
    "own variation: a decimal comma": (
        lines(lambda t, x, y, p: f'"{t / 1000:.3f}",{x},{y},{p}'.replace(".", ","), "t_ms,x,y,p"),
        ImportOptions(),
    ),
    # Records beside other arrays, in ms, which are said to be us: was refused, "no column for t".
    f"{GITHUB}/ChenYichen9527/EV-UAV/issues/19": (records_beside_others, ImportOptions(time_unit="ms")),
    # The newest event first: was right.
    f"{GITHUB}/EventVisionLibrary/evl/issues/27": (
        lambda p: make.text(p, make.Rows(*(column[::-1] for column in VGA)), "{t},{x},{y},{p}", "t,x,y,p"),
        ImportOptions(),
    ),
    # Words beside the events, in front of them or behind words for the polarity: was refused, "are not events".
    "own variation: the camera's name first": (
        lines(lambda t, x, y, p: f"left,{t},{x},{y},{p}", "camera,t,x,y,p"),
        ImportOptions(),
    ),
    "own variation: the camera's name behind a word": (
        lines(lambda t, x, y, p: f"{t},{x},{y},{'on' if p else 'off'},left", "t,x,y,p,camera"),
        ImportOptions(),
    ),
    # The unit in an array or a dataset of its own: was passed over, and the file refused or read as microseconds.
    "own variation: an array for the unit": (
        lambda p: make.npz(p, t=VGA.t * 1000 + 7, x=VGA.x, y=VGA.y, p=VGA.p, time_unit="ns"),
        ImportOptions(),
    ),
    "own variation: a dataset for the unit": (
        lambda p: make.hdf5(p, {"t": VGA.t * 1000 + 7, "x": VGA.x, "y": VGA.y, "p": VGA.p, "units": b"ns"}),
        ImportOptions(),
    ),
    # Addresses of 16 bits with a fraction: was right, with a warning of NumPy.
    "own variation: float16": (
        lambda p: make.npz(p, t=VGA.t, x=VGA.x.astype(np.float16), y=VGA.y.astype(np.float16), p=VGA.p),
        ImportOptions(),
    ),
    # Seconds with more digits than a clock has: was right.
    f"{GITHUB}/neuromorphs/tonic/issues/210": (
        lines(lambda t, x, y, p: f"{t / 1e6:.6f}00000001,{x},{y},{p}"),
        ImportOptions(),
    ),
}

REFUSED: dict[str, tuple[Write, str]] = {
    # Addresses as shares of the picture: was read as the pixels 0 and 1, with a note on undistorted events.
    "own variation: shares of the picture": (
        lines(lambda t, x, y, p: f"{t},{x / 640:.5f},{y / 480:.5f},{p}"),
        "the addresses are shares of the picture",
    ),
    # A clock of 16 bits: was sorted as if its rows came late, 500 ms within 66.
    "own variation: times in 16 bits": (
        lambda p: make.npz(p, t=(VGA.t % 65536).astype(np.uint16), x=VGA.x, y=VGA.y, p=VGA.p),
        "whole numbers of 16 bits, and step back",
    ),
    # Feather: was refused, "the format is not recognised".
    "own variation: to_feather": (feather, r"a Feather \(Arrow\) file"),
    # A frame of to_hdf: was refused, "no events in a layout that is known".
    f"{GITHUB}/cta-observatory/cta-lstchain/issues/220": (blocks, "pandas packed into blocks.*data_columns=True"),
    # Histograms made of events, which Prophesee calls precomputed: was right.
    f"{GITHUB}/prophesee-ai/prophesee-automotive-dataset-toolbox/issues/33": (
        lambda p: make.hdf5(p, {"data": np.zeros((3, 2, 48, 64), np.uint8)}, delta_t=50_000, mode="histo"),
        "no events in a layout that is known; got an HDF5 file of data",
    ),
    # In ms, without being told so: was refused, "no column for t".
    f"{GITHUB}/ChenYichen9527/EV-UAV/issues/19": (records_beside_others, "give --time-unit ms"),
    # Rows that count from 240: was right.
    f"{GITHUB}/neuromorphs/tonic/issues/94": (
        lines(lambda t, x, y, p: f"{t},{x},{y + 240},{p}"),
        "expected a sensor of at least 640x7[12]",
    ),
    # Addresses that lost their upper bits: was read, everything within 256 x 256 of 640 x 480.
    "own variation: addresses in 8 bits": (
        lambda p: make.npz(p, t=VGA.t, x=(VGA.x % 256).astype(np.uint8), y=VGA.y, p=VGA.p),
        "x is stored in 8 bits.*--width",
    ),
    # Two cameras in one table: was read as one camera that saw everything twice.
    "own variation: a column for the camera": (
        lines(lambda t, x, y, p: f"{t},{x},{y},{p},{t % 2}", "t,x,y,p,cam_id"),
        "several cameras.*got 0, 1",
    ),
    "own variation: a field for the camera in records": (
        lambda p: make.npy(p, FRAME.assign(camera=VGA.t % 2).to_records(index=False)),
        "several cameras.*got 0, 1",
    ),
    "own variation: an array for the camera": (
        lambda p: make.npz(p, camera=VGA.t % 2, t=VGA.t, x=VGA.x, y=VGA.y, p=VGA.p),
        "several cameras.*got 0, 1",
    ),
    "own variation: a dataset for the camera": (
        lambda p: make.hdf5(p, {f"events/{name}": one for name, one in (*VGA._asdict().items(), ("cam", VGA.t % 2))}),
        "several cameras.*got 0, 1",
    ),
    "own variation: records in HDF5 with the camera": (
        lambda p: make.hdf5(p, {"events": FRAME.assign(cam_id=VGA.t % 2).to_records(index=False)}),
        "several cameras.*got 0, 1",
    ),
    # Seconds and what is beyond them in two columns, as of ROS: was read, all events of a second at one time; in HDF5
    # the rest of the second alone, so that the seconds lay one over the other.
    "own variation: seconds and nanoseconds": (
        lines(lambda t, x, y, p: f"{SECONDS + t // 10**6},{t % 10**6}000,{x},{y},{p}", "ts.secs,ts.nsecs,x,y,polarity"),
        "split over two columns.*1000000000 [*] ts.secs [+] ts.nsecs",
    ),
    "own variation: seconds and microseconds": (
        lines(lambda t, x, y, p: f"{t // 10**6},{t % 10**6},{x},{y},{p}", "t_sec,t_usec,x,y,p"),
        "split over two columns.*1000000 [*] t_sec [+] t_usec",
    ),
    "own variation: seconds and nanoseconds as arrays": (
        lambda p: make.npz(p, **SPLIT),
        "split over two columns",
    ),
    "own variation: seconds and nanoseconds in records": (
        lambda p: make.npy(p, pd.DataFrame(SPLIT).to_records(index=False)),
        "split over two columns",
    ),
    "own variation: seconds and nanoseconds in a MAT-file": (
        lambda p: make.mat5(p, TD=SPLIT),
        "split over two columns",
    ),
    "own variation: seconds and nanoseconds in HDF5": (
        lambda p: make.hdf5(p, {f"events/{name}": one for name, one in SPLIT.items()}),
        "split over two columns",
    ),
    "own variation: seconds and nanoseconds in records in HDF5": (
        lambda p: make.hdf5(p, {"events": pd.DataFrame(SPLIT).to_records(index=False)}),
        "split over two columns",
    ),
    # Seconds in a column called t_us: was read, everything within a microsecond.
    "own variation: seconds called us": (
        lines(lambda t, x, y, p: f"{t / 1e6:.6f},{x},{y},{p}", "t_us,x,y,p"),
        "the times cannot be microseconds, which the file states",
    ),
    # A link whose file is gone was an AttributeError; a time of day was said to be no event, and no more.
    "own variation: a broken link": (lambda p: linked(p, "events"), "it links to other files; got events -> gone.h5"),
    "own variation: a broken link in a group": (lambda p: linked(p, "events/x"), "it links to other files; got x -> "),
    "own variation: times of day": (
        lines(lambda t, x, y, p: f"12:00:00.{t:06},{x},{y},{p}"),
        "are not events.*write the date before the time of day",
    ),
    "own variation: what is no date": (lines(lambda t, x, y, p: f"2025-13-01 25:00:00,{x},{y},{p}"), "are not events"),
}


@pytest.mark.parametrize("report", READ)
def test_a_table_that_others_misread_is_read(report: str, tmp_path: Path) -> None:
    write, options = READ[report]
    path = write(tmp_path / "events.bin")
    assert (
        import_recording(ImportOrder([path], sensor=SensorSize(640, 480), options=options), tmp_path / "out.h5")
        is not None
    )
    with open_recording(tmp_path / "out.h5") as recording:
        found = recording.cameras["camera"].slice(0, 10**9)
    for name, column in zip(("t_us", "x_px", "y_px", "on"), VGA, strict=True):
        np.testing.assert_array_equal(getattr(found, name), column, err_msg=name)


@pytest.mark.parametrize("report", REFUSED)
def test_a_table_that_cannot_be_read_is_refused_with_the_cause(report: str, tmp_path: Path) -> None:
    write, said = REFUSED[report]
    path = write(tmp_path / "events.bin")
    with pytest.raises(RecordingError, match=said):
        import_recording(ImportOrder([path], sensor=SensorSize(640, 480)), tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()


NOTED: dict[str, tuple[Write, str]] = {
    # The same file twice in one: was sorted, without a word.
    "own variation: every row twice": (
        lambda p: make.write(p, pd.concat([FRAME, FRAME]).to_csv(index=False).encode()),
        "are there a second time, with equal t, x, y and polarity; was the file written twice",
    ),
    # A spreadsheet that keeps six digits of a time: was read without a word, all events at four times.
    "own variation: 1.00003E+10": (
        lines(lambda t, x, y, p: f"{1e10 + t:.5E},{x},{y},{p}"),
        "600 events have few times, 100 ms or more apart; were the times rounded",
    ),
    # Addresses from 1: the last column and row were left out, without a word of the reason.
    "own variation: pixels from 1 in CSV": (
        lines(lambda t, x, y, p: f"{t},{x + 1 if t else 640},{y + 1},{p}"),
        "no address is 0, the last ones are 640, 4",
    ),
    # Two groups of events, of which one is called as usual: the other was not mentioned.
    "own variation: filtered events beside the raw ones": (
        lambda p: make.hdf5(
            p, {f"{group}/{name}": one for group in ("events", "filtered") for name, one in VGA._asdict().items()}
        ),
        "also holds events in filtered, which are not read",
    ),
}


def test_columns_without_names_that_fill_a_turned_sensor_are_noted(tmp_path: Path) -> None:
    """The order t, y, x, p was read as t, x, y, p, without a word of it."""
    path = make.npy(tmp_path / "a.npy", np.stack([VGA.t, VGA.y, VGA.x, VGA.p], axis=1))
    made = import_recording(ImportOrder([path]), tmp_path / "out.h5")
    assert made is not None and "fills a 640x480 sensor if y stands before x; then name" in " ".join(made.notes)


@pytest.mark.parametrize("report", NOTED)
def test_what_a_table_may_have_lost_is_noted(report: str, tmp_path: Path) -> None:
    write, said = NOTED[report]
    path = write(tmp_path / "events.bin")
    made = import_recording(ImportOrder([path], sensor=SensorSize(640, 480)), tmp_path / "out.h5")
    assert made is not None and said in " ".join(made.notes)
