"""HDF5 files of data sets and simulators, made here after their descriptions."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources import open_sources
from tests.four_events import P, T, X, Y, read_all


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


@pytest.mark.parametrize("place", ["{}/t_offset", "{}/events/t_offset"])
def test_each_camera_of_one_file_has_the_clock_offset_beside_its_events(tmp_path, place):
    path = tmp_path / "pair.h5"
    with h5py.File(path, "w") as file:
        file["t_offset"] = 7
        for camera in ("left", "right"):
            for name, column in zip("txyp", (T, X, Y, P), strict=True):
                file[f"{camera}/events/{name}"] = column
        file[place.format("right")] = 200_000
    left, right = open_sources(path, SensorSize(320, 240))
    assert read_all(left)[0].t_us.tolist() == (T + 7).tolist()
    assert read_all(right)[0].t_us.tolist() == (T + 200_000).tolist()
