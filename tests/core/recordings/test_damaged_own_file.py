"""A recording of ours that lacks something, or of another writer: what is left of it, and what is said."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from core.errors import RecordingError
from core.recordings import open_recording
from tests.core.recordings.open_recording_whole import open_recording_whole
from tests.core.recordings.sample_recording import (
    DURATION_US,
    ELSEWHERE,
    EVENTS,
    write_elsewhere,
    write_sample_recording,
)


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    path = tmp_path / "sample.h5"
    write_sample_recording(path)
    return path


def change(path: Path, act) -> None:
    with h5py.File(path, "r+") as file:
        act(file)


def replace(file: h5py.File, name: str, values) -> None:
    del file[name]
    file[name] = values


def test_a_whole_one_opens_with_its_own_note_only(sample: Path) -> None:
    assert open_recording_whole(sample) == ("Made to be damaged.",)
    with open_recording(sample) as recording:
        assert {"/racket", "/ground_truth/ball", "/readout/left"} <= set(recording.groups)


def test_what_can_be_computed_need_not_be_there(sample: Path) -> None:
    with open_recording(sample) as whole:
        counts = whole.cameras["left"].counts_per_ms()
        last_us = max(int(camera.slice(0, DURATION_US).t_us[-1]) for camera in whole.cameras.values())
    change(sample, lambda file: (file.attrs.__delitem__("duration_us"), file.__delitem__("cameras/left/ms_to_idx")))
    with open_recording(sample) as recording:
        assert recording.duration_us == last_us + 1
        np.testing.assert_array_equal(recording.cameras["left"].counts_per_ms(), counts)
        assert len(recording.cameras["left"].slice(0, recording.duration_us)) == EVENTS["left"]
        assert sum("computed again" in note or "duration" in note for note in recording.notes) == 2


def test_a_duration_below_the_events_is_theirs(sample: Path) -> None:
    change(sample, lambda file: file.attrs.__setitem__("duration_us", 1000))
    with open_recording(sample) as recording:
        assert recording.duration_us > 50_000
        assert recording.cameras["left"].counts_per_ms().sum() == EVENTS["left"]


def test_a_damaged_camera_leaves_the_other(sample: Path) -> None:
    change(sample, lambda file: file.__delitem__("cameras/left/events/x"))
    with open_recording(sample) as recording:
        assert list(recording.cameras) == ["right"]
        assert any("Camera left is left out" in note and "dataset x is missing" in note for note in recording.notes)


def test_an_index_that_lies_is_not_believed(sample: Path) -> None:
    def shift(file: h5py.File) -> None:
        marks = file["cameras/left/ms_to_idx"][()]
        marks[1:] = np.minimum(marks[1:] + 5, marks[-1])
        replace(file, "cameras/left/ms_to_idx", marks)

    change(sample, shift)
    with open_recording(sample) as recording, pytest.raises(RecordingError, match="ms_to_idx does not fit the times"):
        recording.cameras["left"].slice(20_000, 22_000)


@pytest.mark.parametrize("column", ["t_us", "u_px", "visible"])
def test_truth_without_a_column_is_left_out_with_a_note(sample: Path, column: str) -> None:
    change(sample, lambda file: file.__delitem__(f"ground_truth/left/{column}"))
    with open_recording(sample) as recording:
        assert recording.cameras["left"].truth is None
        assert any(f"column {column} is missing" in note for note in recording.notes)
        assert recording.cameras["right"].truth is not None


def test_absurd_truth_is_not_visible(sample: Path) -> None:
    change(sample, lambda file: file["ground_truth/left/u_px"].__setitem__(slice(0, 4), [np.nan, np.inf, 1e300, 20]))
    with open_recording(sample) as recording:
        truth = recording.cameras["left"].truth
        assert truth is not None and truth.visible[:5].tolist() == [False, False, False, True, True]


@pytest.mark.parametrize("kind", ["link", "storage", "view"])
def test_nothing_of_another_file_is_read(sample: Path, kind: str) -> None:
    write_elsewhere(sample.with_name(ELSEWHERE))

    def lead_away(file: h5py.File) -> None:
        name, shape = "cameras/right/events/x", (EVENTS["right"],)
        del file[name]
        if kind == "link":
            file[name] = h5py.ExternalLink(ELSEWHERE, f"/{name}")
        elif kind == "storage":
            file.create_dataset(name, shape, "u2", external=[(ELSEWHERE, 0, h5py.h5f.UNLIMITED)])
        else:
            layout = h5py.VirtualLayout(shape, "u2")
            layout[...] = h5py.VirtualSource(ELSEWHERE, name, shape)
            file.create_virtual_dataset(name, layout)

    change(sample, lead_away)
    with open_recording(sample) as recording:
        assert list(recording.cameras) == ["left"]
        assert any("another file" in note for note in recording.notes)


def test_a_uuid_that_could_be_a_path_is_refused(sample: Path) -> None:
    change(sample, lambda file: file.attrs.__setitem__("uuid", "../../x"))
    with pytest.raises(RecordingError, match="the uuid is damaged"):
        open_recording(sample)
