"""Which cameras a prediction is made from, as a column of the recording file."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from core.chain.chain import ChainState, StageSeconds
from core.errors import RecordingError
from core.events import SensorSize
from core.history.recorded_rally import PREDICTIONS, prediction_rows
from core.recordings import RecordingWriter, open_recording
from core.recordings.layout import check_known_rows
from core.trajectory import FilterPredictor

RIG = ("near_left", "near_right", "f\u00e4r")


def state(*cameras: str) -> ChainState:
    """A step that made a prediction from these cameras."""
    predictor, found = FilterPredictor(), None
    for t_us in range(0, 100_000, 2000):
        t_s = 1e-6 * t_us
        found = predictor.add(t_us, [1.0 - 5 * t_s, 0.0, 0.3 + 2 * t_s - 4.9 * t_s**2]) or found
    assert found is not None and found.hit_plane is not None
    return ChainState(found.t_us, {}, None, None, found, True, (), StageSeconds(0, 0, 0), predicted_from=cameras)


def write(path: Path, *rows) -> Path:
    with RecordingWriter(path, dict.fromkeys(RIG, SensorSize(64, 48))) as writer:
        for one in rows:
            writer.append_rows(PREDICTIONS, one)
    return path


def test_a_file_names_the_cameras_of_each_prediction(tmp_path: Path) -> None:
    made = [("near_right",), RIG, ()]
    file = write(tmp_path / "a.h5", *(prediction_rows(state(*cameras), 0, RIG) for cameras in made))
    with open_recording(file) as recording:
        rows = recording.read_rows(PREDICTIONS)
    assert [text.decode() for text in rows["cameras"].tolist()] == ["+".join(cameras) for cameras in made]
    with h5py.File(file) as opened:
        assert opened["/predictions/cameras"][1].decode() == "near_left+near_right+f\u00e4r", "with any reader"


def test_a_file_of_before_has_no_such_column_and_one_of_numbers_is_refused(tmp_path: Path) -> None:
    rows = prediction_rows(state("near_left"), 0)
    assert rows is not None and rows["cameras"].tolist() == [b"near_left"]
    with pytest.raises(RecordingError, match="column cameras"):
        check_known_rows(PREDICTIONS, rows | {"cameras": np.array([3])})
    del rows["cameras"]
    with open_recording(write(tmp_path / "old.h5", rows)) as recording:
        assert recording.read_rows(PREDICTIONS).keys() == rows.keys()


def test_a_ball_that_does_not_come_to_the_plane_has_no_row() -> None:
    expected = state("near_left")
    assert expected.prediction is not None
    away = replace(expected, prediction=replace(expected.prediction, hit_plane=None))
    assert prediction_rows(away, 0) is None and prediction_rows(replace(away, prediction=None), 0) is None
