"""NumPy files of data sets, made here after their descriptions; pickles are refused."""

from __future__ import annotations

import io
import pickle
import zipfile

import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings import open_recording
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport

T = np.array([5, 5, 9, 1_500_000])
X = np.array([0, 319, 3, 100])
Y = np.array([239, 0, 7, 50])
P = np.array([1, 0, 0, 1])


def read_the_four_events(path, sensor=None):
    (source,) = open_sources(path, sensor)
    report = DecodeReport()
    events = concatenate_events(list(source.read(report)), source.sensor)
    assert events.t_us.tolist() == T.tolist()
    assert events.x_px.tolist() == X.tolist()
    assert events.y_px.tolist() == Y.tolist()
    assert events.on.tolist() == [True, False, False, True]
    return source, report.notes


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


def test_a_folder_of_anything_else_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="a folder without events"):
        open_sources(tmp_path)


def test_evimo_polarities_that_count_are_refused(tmp_path):
    path = tmp_path / "counts.npz"
    np.savez(path, events=np.stack([T / 1e6, X, Y, [0, 1, 2, 3]], axis=1), mask=np.zeros((1, 480, 640), "u1"))
    (source,) = open_sources(path)
    with pytest.raises(RecordingError, match=r"ON cannot be told; .* got 0, 1, 2, 3; give --polarity"):
        list(source.read(DecodeReport()))


@pytest.mark.parametrize("form", ["archive", "old archive", "pickle"])
def test_a_pickled_file_is_refused_in_one_line_and_never_opened(tmp_path, form):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was loaded",))

    path = tmp_path / "labels.pt"
    data = pickle.dumps({"ball_position": Trap()}, protocol=2)
    if form == "archive":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("labels/data.pkl", data)
            archive.writestr("labels/version", "3\n")
    elif form == "old archive":
        path.write_bytes(pickle.dumps(0x1950A86A20F9469CFC6C, protocol=2) + data)
    else:
        file = io.BytesIO()
        pickle.dump([1, 2], file)
        path.write_bytes(file.getvalue())
    with pytest.raises(RecordingError, match="a pickled file is not opened: it could run any program") as caught:
        open_sources(path)
    assert "numpy.savez" in str(caught.value)
    assert "\n" not in str(caught.value)
