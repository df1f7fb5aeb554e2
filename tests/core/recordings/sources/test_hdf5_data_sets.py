"""HDF5 files of data sets and simulators, made here after their descriptions."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings import import_recording, open_recording
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport

T = np.array([5, 5, 9, 1_500_000])
X = np.array([0, 319, 3, 100])
Y = np.array([239, 0, 7, 50])
P = np.array([1, 0, 0, 1])


def read_all(source):
    report = DecodeReport()
    return concatenate_events(list(source.read(report)), source.sensor), report


def write_v2e(path, polarity, frames=None):
    with h5py.File(path, "w") as file:
        rows = np.stack([T, X, Y, polarity], axis=1).astype("u4")
        file.create_dataset("events", data=rows, maxshape=(None, 4), compression="gzip")
        if frames is not None:
            file["frame"] = frames


@pytest.mark.parametrize("off", [0, 2**32 - 1])
def test_a_v2e_file_gives_its_events_with_either_spelling_of_off(tmp_path, off):
    path = tmp_path / "v2e.h5"
    write_v2e(path, np.where(P == 1, 1, off))
    (source,) = open_sources(path, SensorSize(320, 240))
    events, report = read_all(source)
    assert events.t_us.tolist() == T.tolist()
    assert events.x_px.tolist() == X.tolist()
    assert events.y_px.tolist() == Y.tolist()
    assert events.on.tolist() == [True, False, False, True]
    assert source.format == "v2e HDF5"
    assert "the columns of /events are taken for t, x, y, p" in report.notes[0]


def test_the_frames_of_a_v2e_file_tell_the_size_of_its_sensor(tmp_path):
    path = tmp_path / "v2e.h5"
    write_v2e(path, P, frames=np.zeros((2, 260, 346), "u1"))
    (source,) = open_sources(path)
    assert source.sensor == SensorSize(346, 260)


def test_a_v2e_file_with_unknown_polarities_is_refused(tmp_path):
    path = tmp_path / "v2e.h5"
    write_v2e(path, np.array([1, 2, 0, 1]))
    (source,) = open_sources(path, SensorSize(320, 240))
    with pytest.raises(RecordingError, match=r"which polarity is ON cannot be told; .* got 0, 1, 2; give --polarity"):
        read_all(source)


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
    import_recording([path], tmp_path / "out.h5")
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
    import_recording([path], tmp_path / "out.h5", calibration=mine)
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
