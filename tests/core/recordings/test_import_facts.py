"""Every reader states what is known of a file before it is imported, and the import then finds the same."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings import ImportOrder, check_import, import_recording, open_recording
from core.recordings.sources import open_sources
from core.recordings.sources.readers import HEAD_BYTES, READERS, recognised
from core.recordings.sources.source import POLARITY, TIME_UNIT, DecodeReport, FactOrigin, ImportOptions
from tests.core.recordings.conftest import FORMATS, random_events
from tests.core.recordings.sources import test_address_formats as addresses
from tests.core.recordings.sources import test_evt4 as evt4
from tests.core.recordings.sources.ros.bag_writing import BagMaker, evt3_words
from tests.core.recordings.sources.test_hdf5_tables import P, T, X, Y, write_v2e
from tests.docs.test_data_set_readers import nmnist, write_m3ed
from tests.labels.formats.test_sony import YAML, write_rally
from tests.strangers.event_files import aedat3, draw_rows, mat5

pytestmark = pytest.mark.usefixtures("data_set_readers")
VGA = SensorSize(640, 480)


def write_evt4(path: Path) -> None:
    evt4.write(path, [evt4.high(3), evt4.event(9, 8, 5, True), evt4.event(7, 6, 6, False)])


def write_aedat2(path: Path) -> None:
    addresses.write(path, addresses.DVS128, [(addresses.dvs128(1, 2, True), 100), (addresses.dvs128(3, 4, False), 101)])


def write_nmnist(path: Path) -> None:
    path.write_bytes(nmnist(33, 0, True, 5) + nmnist(1, 2, False, 7))


def write_n_imagenet(path: Path) -> None:
    records = np.zeros(4, [("x", "<u2"), ("y", "<u2"), ("t", "<i8"), ("p", "?")])
    records["x"], records["y"], records["t"], records["p"] = X, Y, T, P
    np.savez(path.open("wb"), event_data=records)


def write_evimo(path: Path) -> None:
    events = np.stack([T / 1e6, X, Y, P], axis=1)
    np.savez(path.open("wb"), events=events, depth=np.zeros((3, 480, 640), "f4"))


def write_evimo_folder(path: Path) -> None:
    path.mkdir()
    np.save(path / "dataset_events_t.npy", T / 1e6)
    np.save(path / "dataset_events_xy.npy", np.stack([X, Y], axis=1).astype("u2"))
    np.save(path / "dataset_events_p.npy", P.astype("u1"))
    np.savez(path / "dataset_mask.npz", mask_0000000000=np.zeros((480, 640), "u2"))


def write_rows(path: Path) -> None:
    np.save(path.open("wb"), np.stack([T, X, Y, P], axis=1))


def write_sony(path: Path) -> None:
    write_rally(path.parent / "capture", "evsA", 1_000_000)
    (path.parent / "capture" / "rig.yaml").write_text(YAML)
    (path.parent / "capture" / "h5").rename(path)
    (path.parent / "rig.yaml").write_text(YAML)


def write_array_bag(path: Path) -> None:
    with BagMaker(path, "ros1") as bag:
        bag.add_events("/dvs/events", [(5_000_000, 1, 2, True), (5_000_010, 3, 4, False)])


def write_packet_bag(path: Path) -> None:
    with BagMaker(path, "mcap") as bag:
        for topic, t, late_us in (("/left/events", 9000, 0), ("/right/events", 9500, 3000)):
            words = evt3_words([(t, 1, 2, True), (t + 100, 1, 3, False)])
            bag.add_packet(topic, words, "evt3", (10**12 + t + late_us) * 1000)


BUILDERS: dict[str, Callable[[Path], object]] = {
    **{
        name: lambda path, write=write: write(
            path, random_events(500, seed=5, duration_us=300_000, sensor=SensorSize(346, 260), start_us=7_000_000)
        )
        for name, write in FORMATS.items()
    },
    "evt4": write_evt4,
    "aedat2": write_aedat2,
    "aedat3": lambda path: path.write_bytes(aedat3(draw_rows(346, 260))),
    "matlab": lambda path: mat5(path, TD=draw_rows(346, 260)._asdict()),
    "n-mnist.bin": write_nmnist,
    "n-imagenet": write_n_imagenet,
    "evimo": write_evimo,
    "evimo2 folder": write_evimo_folder,
    "npy rows": write_rows,
    "v2e": lambda path: write_v2e(path, P),
    "m3ed": write_m3ed,
    "sony folder": write_sony,
    "bag of arrays": write_array_bag,
    "bag of packets": write_packet_bag,
}
ASSUMED = {
    "dsec": [], "evt2": [], "evt2.1": [], "evt3": [], "evt4": [], "metavision": [], "aedat4": [], "es": [], "m3ed": [],
    "evimo": [], "evimo2 folder": [], "sony folder": [], "bag of arrays": [], "dat": [],
    "mvsec": ["sensor size"], "n-mnist.bin": ["sensor size"], "n-imagenet": ["sensor size"],
    "npz": ["sensor size", "unit"], "csv": ["sensor size", "unit"], "xs_ys_ts_ps": ["sensor size", "unit"],
    "raw_events": ["sensor size", "unit"], "text": ["sensor size", "columns", "unit"],
    "npy rows": ["sensor size", "columns", "unit"],
    "v2e": ["sensor size", "taken for t, x, y, p", "the unit of its times"],
    "aedat3": [], "matlab": ["sensor size", "unit"],
    "aedat2": ["bit 0"], "bag of packets": ["one clock"],
}  # fmt: skip


@pytest.fixture(params=sorted(BUILDERS))
def built(request, tmp_path) -> tuple[str, Path]:
    folder = tmp_path / "in"
    folder.mkdir()
    path = folder / request.param
    BUILDERS[request.param](path)
    return request.param, path


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    return {str(path): (path.stat().st_size, path.stat().st_mtime_ns) for path in folder.rglob("*")}


def test_every_reader_states_every_fact_and_the_import_finds_the_same(built, tmp_path):
    name, path = built
    before = listing(tmp_path)
    facts = check_import(ImportOrder([path]))
    assert facts is not None and facts.complete
    assert listing(tmp_path) == before  # nothing is written
    origins = {str(one) for one in FactOrigin}
    for camera in facts.cameras:
        assert camera.format and camera.width_px > 0 and camera.height_px > 0
        assert {camera.sensor_from, camera.time_unit_from, camera.polarity_from} <= origins
        assert camera.time_unit in ("seconds", "milliseconds", "microseconds", "nanoseconds")
        assert "= ON" in camera.polarity and "= OFF" in camera.polarity
        assert camera.events == camera.on_events + camera.off_events > 0
        assert camera.first_us is not None and camera.first_us <= camera.last_us
    for wanted in ASSUMED[name]:
        assert any(wanted in line for line in facts.assumed), wanted
    assert len(facts.assumed) == len(ASSUMED[name])
    summary = import_recording(ImportOrder([path]), tmp_path / "a.h5")
    assert summary is not None
    assert (summary.facts, summary.notes, summary.duration_us) == (facts, facts.notes, facts.duration_us)
    with open_recording(tmp_path / "a.h5") as recording:
        assert set(facts.assumed) <= set(recording.notes) == set(facts.notes)
        assert recording.duration_us == facts.duration_us
        for camera in facts.cameras:
            stream = recording.cameras[camera.name]
            events = stream.slice(0, recording.duration_us)
            assert (len(events), int(events.on.sum())) == (camera.events, camera.on_events)
            assert int(events.t_us[0]) + stream.t_offset_us == camera.first_us
            assert int(events.t_us[-1]) + stream.t_offset_us == camera.last_us
            assert str(stream.sensor) == f"{camera.width_px}x{camera.height_px}"
            assert (stream.calibration is not None) == (camera.calibration_from is not None)


def test_every_reader_states_unit_and_polarity_itself(built):
    _, path = built
    for source in open_sources(path):
        report = DecodeReport()
        concatenate_events(list(source.read(report)), source.sensor)
        assert {TIME_UNIT, POLARITY} <= {**source.facts, **report.facts}.keys()


def test_the_files_above_are_of_all_readers(tmp_path):
    used = set()
    for name, build in BUILDERS.items():
        folder = tmp_path / name
        folder.mkdir()
        build(folder / name)
        path = folder / name
        reader = recognised(path, path.read_bytes()[:HEAD_BYTES] if path.is_file() else b"")
        used.add(next(key for key, one in READERS.items() if one is reader))
    assert used == set(READERS)


def test_a_size_that_is_given_is_said_to_be_given(built):
    name, path = built
    if name in ("aedat2",):
        with pytest.raises(RecordingError, match="contradicts the header"):
            check_import(ImportOrder([path], sensor=VGA))
        return
    size = SensorSize(1280, 720) if name in ("m3ed", "sony folder") else VGA
    facts = check_import(ImportOrder([path], sensor=size))
    assert facts is not None
    assert {(camera.sensor_from, camera.width_px) for camera in facts.cameras} == {("option", size.width_px)}
    assert not any("sensor size" in line for line in facts.assumed)


def test_what_is_left_out_and_put_right_is_counted(tmp_path):
    path = tmp_path / "a.csv"
    lines = [f"{1000 + 10 * i},{i % 30},{i % 20},{i % 2}" for i in range(2000)]
    lines[50], lines[60] = "1600,5000,3,1", "no event"
    lines[100], lines[101] = lines[101], lines[100]
    lines[700] = "99000000,3,3,0"
    lines[900] = "10000,3,3,7"
    path.write_text("t_us,x,y,p\n" + "\n".join(lines) + "\n")
    facts = check_import(ImportOrder([path], sensor=SensorSize(30, 20)))
    assert facts is not None
    (camera,) = facts.cameras
    assert camera.left_out == {
        "lines that are no events": 1, "odd values": 1, "outside the sensor": 1, "wrong time": 1,
    }  # fmt: skip
    assert camera.changed == {"sorted by time": 1}
    assert (camera.time_unit, camera.time_unit_from) == ("microseconds", "file")
    assert camera.events == 1996 and facts.needs_a_look and facts.assumed == ()


def test_reserved_words_and_addresses_outside_are_counted_in_a_stream(tmp_path):
    words = [0x8001, 0x6002, 0x0003, 0x2005, 0x1234, 0xB000, 0x2000 | 700, 0x2006] + [0x2007] * 400
    path = tmp_path / "a.raw"
    path.write_bytes(b"% format EVT3;height=480;width=640\n% end\n" + np.array(words, "<u2").tobytes() + b"\0")
    facts = check_import(ImportOrder([path]))
    assert facts is not None
    assert facts.cameras[0].left_out == {"bytes at the end": 1, "reserved words": 2}
    words[4:6] = []
    path.write_bytes(b"% format EVT3;height=480;width=640\n% end\n" + np.array(words, "<u2").tobytes())
    facts = check_import(ImportOrder([path]))
    assert facts is not None
    assert facts.cameras[0].left_out == {"outside the sensor": 1}
    assert facts.cameras[0].events == 402


@pytest.mark.parametrize("unit", ["ns", "ms"])
def test_what_is_stated_counts_and_a_contradiction_is_said(tmp_path, unit):
    path = tmp_path / "a.csv"
    path.write_text("t_us,x,y,p\n1000,1,2,1\n3000,3,4,2\n")
    options = ImportOptions(unit, {"1": True, "2": False})
    facts = check_import(ImportOrder([path], sensor=VGA, options=options))
    assert facts is not None
    (camera,) = facts.cameras
    assert (camera.time_unit_from, camera.polarity_from) == ("option", "option")
    assert camera.polarity == "1 = ON, 2 = OFF"
    assert any("(--time-unit), though it says us" in line for line in facts.assumed)
    assert facts.duration_us == {"ns": 3, "ms": 2_000_001}[unit]


def test_options_that_a_format_does_not_need_are_said_to_be_unused(tmp_path):
    path = tmp_path / "a.raw"
    write_evt4(path)
    facts = check_import(ImportOrder([path], options=ImportOptions("ns", {"1": False, "0": True})))
    assert facts is not None
    assert [note for note in facts.notes if "was not used" in note] == [
        "--time-unit was not used: Prophesee EVT4 defines its time unit.",
        "--polarity was not used: Prophesee EVT4 defines its polarity.",
    ]


def test_a_plain_file_needs_no_look_and_a_check_can_be_cut_short(tmp_path):
    path = tmp_path / "a.hdf5"
    FORMATS["metavision"](path, random_events(300_000, seed=1, duration_us=900_000, sensor=VGA))
    whole = check_import(ImportOrder([path]))
    assert whole is not None and not whole.needs_a_look
    first = check_import(ImportOrder([path]), longest_s=0.0)
    assert first is not None and not first.complete
    assert first.cameras[0].events < whole.cameras[0].events == 300_000
    assert dataclasses.replace(first.cameras[0], events=0, on_events=0, off_events=0, first_us=0, last_us=0,
                               polarity="") == dataclasses.replace(
        whole.cameras[0], events=0, on_events=0, off_events=0, first_us=0, last_us=0, polarity=""
    )  # fmt: skip
    assert check_import(ImportOrder([path]), cancelled=lambda: True) is None


def test_polarities_of_metavision_records_are_looked_at(tmp_path):
    records = np.zeros(6, [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    records["t"], records["p"] = np.arange(6), [-1, 1, -1, 1, 1, 1]
    path = tmp_path / "a.hdf5"
    with h5py.File(path, "w") as file:
        file["CD/events"] = records
        file.attrs["geometry"] = "640x480"
    facts = check_import(ImportOrder([path]))
    assert facts is not None and facts.cameras[0].polarity == "-1 = OFF, 1 = ON"
    records["p"][1:5] = 5
    with h5py.File(path, "w") as file:
        file["CD/events"] = records
    with pytest.raises(RecordingError, match="which polarity is ON cannot be told"):
        check_import(ImportOrder([path]))
