"""The example plugins that read N-MNIST, N-ImageNet, EVIMO and M3ED; files are made after their descriptions."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings import ImportOrder, import_recording, open_recording
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport
from tests.four_events import P, T, X, Y, read_all

pytestmark = pytest.mark.usefixtures("data_set_readers")


def read_the_four_events(path, sensor=None):
    (source,) = open_sources(path, sensor)
    events, report = read_all(source)
    assert events.t_us.tolist() == T.tolist()
    assert events.x_px.tolist() == X.tolist()
    assert events.y_px.tolist() == Y.tolist()
    assert events.on.tolist() == [True, False, False, True]
    return source, report.notes


def nmnist(x, y, on, t):
    return bytes([x, y, int(on) << 7 | t >> 16, t >> 8 & 0xFF, t & 0xFF])


def test_a_sample_of_n_mnist_has_its_values_and_its_clock_goes_on(tmp_path):
    path = tmp_path / "00002.bin"
    later = nmnist(1, 33, False, 7) + nmnist(2, 3, True, 70_000)
    path.write_bytes(nmnist(33, 0, True, 5) + nmnist(0, 240, False, 6) + later)
    (source,) = open_sources(path)
    events, report = read_all(source)
    rows = zip(events.t_us.tolist(), events.x_px.tolist(), events.y_px.tolist(), events.on.tolist(), strict=True)
    assert list(rows) == [(5, 33, 0, True), (8199, 1, 33, False), (78_192, 2, 3, True)]
    assert (source.format, str(source.sensor)) == ("N-MNIST, 40-bit events", "34x34")
    assert report.notes == [
        "00002.bin does not name its sensor size; 34x34 is assumed, that of N-MNIST, 40-bit events."
    ]


def test_other_binary_files_are_not_taken_for_n_mnist(tmp_path):
    files = {"a.bin": bytes(range(250, 0, -1)) * 2, "b.bin": b"\xff\x00" * 7, "c.dat": nmnist(1, 200, True, 5) * 2}
    for name, data in files.items():
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(RecordingError, match="the format is not recognised"):
            open_sources(path)


def test_an_n_imagenet_file_gives_its_events_and_says_what_size_was_assumed(tmp_path):
    records = np.zeros(4, [("x", "<u2"), ("y", "<u2"), ("t", "<i8"), ("p", "?")])
    records["x"], records["y"], records["t"], records["p"] = X, Y, T, P
    np.savez_compressed(tmp_path / "n01440764_10026.npz", event_data=records)
    source, notes = read_the_four_events(tmp_path / "n01440764_10026.npz")
    assert (source.format, str(source.sensor)) == ("N-ImageNet NumPy", "640x480")
    assert "640x480 is assumed, that of N-ImageNet" in notes[0]
    assert read_the_four_events(tmp_path / "n01440764_10026.npz", SensorSize(320, 240))[1] == []


def test_an_evimo_archive_gives_its_events_the_size_of_its_depth_and_loads_no_pickle(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was loaded",))

    path = tmp_path / "scene_00_dyn_train_00.npz"
    meta = np.array([Trap()], dtype=object)
    events = np.stack([T / 1e6, X, Y, P], axis=1)
    np.savez(path, events=events, depth=np.zeros((3, 480, 640), "f4"), meta=meta, K=np.eye(3), D=np.zeros(4))
    source, notes = read_the_four_events(path)
    assert (source.format, str(source.sensor), notes) == ("EVIMO NumPy", "640x480", [])


def test_a_folder_of_evimo2_is_one_recording(tmp_path):
    folder = tmp_path / "samsung_mono" / "imo" / "scene_13_dyn_test_00_000000"
    folder.mkdir(parents=True)
    np.save(folder / "dataset_events_t.npy", T / 1e6)
    np.save(folder / "dataset_events_xy.npy", np.stack([X, Y], axis=1).astype("u2"))
    np.save(folder / "dataset_events_p.npy", P.astype("u1"))
    np.savez(folder / "dataset_mask.npz", mask_0000000000=np.zeros((480, 640), "u2"))
    source, notes = read_the_four_events(folder)
    assert (source.format, str(source.sensor)) == ("EVIMO2 NumPy", "640x480")
    assert "ON and OFF the other way round" in notes[0]
    with open_recording(folder) as recording:
        (camera,) = recording.cameras.values()
        assert camera.slice(0, 2_000_000).t_us.tolist() == (T - 5).tolist()
        assert camera.t_offset_us == 5
        first = recording.uuid
    with open_recording(folder) as recording:
        assert recording.uuid == first


def test_evimo_polarities_that_count_are_refused(tmp_path):
    path = tmp_path / "counts.npz"
    np.savez(path, events=np.stack([T / 1e6, X, Y, [0, 1, 2, 3]], axis=1), mask=np.zeros((1, 480, 640), "u1"))
    (source,) = open_sources(path)
    with pytest.raises(RecordingError, match=r"ON cannot be told; .* got 0, 1, 2, 3; give --polarity"):
        list(source.read(DecodeReport()))


def write_m3ed(path, unit=1, model="pinhole"):
    t = np.arange(0, 40_000, 10) * unit
    with h5py.File(path, "w") as file:
        for side, shift in (("left", 0), ("right", 1)):
            group = file.create_group(f"prophesee/{side}")
            group["t"], group["p"] = t, (np.arange(len(t)) % 2).astype("i1")
            group["x"], group["y"] = (np.arange(len(t)) % 1280).astype("u2"), (np.arange(len(t)) % 720).astype("u2")
            group["ms_map_idx"] = np.arange(40, dtype="u8") * 100
            calib = group.create_group("calib")
            calib["camera_model"], calib["distortion_model"] = model, "radtan"
            calib["intrinsics"] = np.array([1034.0, 1033.0, 629.0, 357.0])
            calib["distortion_coeffs"] = np.array([-0.1, 0.12, 0.001, -0.002])
            calib["resolution"] = np.array([1280, 720])
            T_left = np.eye(4)
            T_left[0, 3] = 0.12 * shift
            calib["T_to_prophesee_left"] = T_left


def test_an_m3ed_file_becomes_a_calibrated_stereo_recording(tmp_path):
    path = tmp_path / "falcon_data.h5"
    write_m3ed(path)
    import_recording(ImportOrder([path]), tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        assert list(recording.cameras) == ["left", "right"]
        right = recording.cameras["right"]
        events = right.slice(0, 100_000)
        assert events.t_us.tolist() == list(range(0, 40_000, 10))
        assert events.x_px[1281] == 1
        assert events.on[:4].tolist() == [False, True, False, True]
        camera = right.calibration
        assert camera is not None
        assert camera.K.tolist() == [[1034, 0, 629], [0, 1033, 357], [0, 0, 1]]
        assert camera.distortion.tolist() == [-0.1, 0.12, 0.001, -0.002, 0]
        assert camera.position_world_m.tolist() == [0.12, 0, 0]


def test_a_calibration_that_is_given_stands_above_that_of_the_file(tmp_path):
    path = tmp_path / "falcon_data.h5"
    write_m3ed(path)
    (left, right) = open_sources(path)
    assert left.calibration is not None
    mine = {"left": right.calibration}
    import_recording(ImportOrder([path], calibration=mine), tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        assert recording.cameras["left"].calibration.position_world_m[0] == 0.12
        assert recording.cameras["right"].calibration.position_world_m[0] == 0.12


def test_the_index_of_an_m3ed_file_tells_the_unit_of_its_times_or_refuses_them(tmp_path):
    path = tmp_path / "falcon_data.h5"
    write_m3ed(path, unit=1000)
    events, report = read_all(open_sources(path)[0])
    assert events.t_us.tolist() == list(range(0, 40_000, 10))
    assert "nanoseconds by their index" in report.notes[0]
    path.unlink()
    write_m3ed(path, unit=30)
    with pytest.raises(RecordingError, match="do not fit their index; got 1,170,000 at the index of millisecond 39"):
        open_sources(path)


def test_a_lens_model_of_m3ed_that_is_not_read_is_told(tmp_path):
    path = tmp_path / "falcon_data.h5"
    write_m3ed(path, model="omni")
    source = open_sources(path)[0]
    assert source.calibration is None
    assert "the calibration is left out: calib: unsupported lens model" in read_all(source)[1].notes[0]
    assert "got omni" in read_all(source)[1].notes[0]


def test_a_fisheye_lens_of_m3ed_is_read(tmp_path):
    path = tmp_path / "falcon_data.h5"
    write_m3ed(path)
    with h5py.File(path, "r+") as file:
        for side in ("left", "right"):
            calib = file[f"prophesee/{side}/calib"]
            del calib["distortion_model"], calib["distortion_coeffs"]
            calib["distortion_model"], calib["distortion_coeffs"] = "equidistant", [0.05, -0.01, 0.002, -0.001]
    camera = open_sources(path)[1].calibration
    assert camera is not None
    assert (camera.model, camera.distortion.tolist()) == ("fisheye", [0.05, -0.01, 0.002, -0.001])
