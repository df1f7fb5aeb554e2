"""Windows of events with the ball's centre, as PyTorch takes them."""

import pickle
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from core.data_sets import event_windows, plan_data_set, run_data_set
from core.data_sets.event_windows import EventWindows, collate_windows, count_pictures
from core.data_sets.plan import Making
from core.errors import ConfigError, RecordingError
from core.events import SensorSize
from core.jobs import ALONE
from core.recordings import open_recording

SENSOR = SensorSize(640, 360)
PLAN = plan_data_set(speeds_mps=(8, 9), serves=1, robot=False, seed=1, making=Making(sensor=SENSOR))
FIRST, SECOND = (f"{one.name}.h5" for one in PLAN.recordings)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    run_data_set(PLAN, folder, engine=ALONE)
    return folder


@pytest.fixture
def windows(folder: Path) -> Iterator[EventWindows]:
    windows = EventWindows(folder)
    yield windows
    windows.close()


def test_each_window_holds_its_events_and_the_centre_at_its_middle(windows: EventWindows, folder: Path) -> None:
    assert {windows[number]["recording"] for number in range(0, len(windows), 20)} == {FIRST, SECOND}
    for number in (0, len(windows) // 3, len(windows) // 2, -1):
        sample = windows[number]
        start_us = sample["start_us"]
        with open_recording(folder / sample["recording"]) as recording:
            stream = recording.cameras[sample["camera"]]
            events, truth = stream.slice(start_us, start_us + 2000), stream.truth
            assert truth is not None
            at = truth.at(start_us + 1000)
        columns = sample["events"]
        assert len(columns) == len(events.t_us)
        np.testing.assert_array_equal(columns[:, :2], np.column_stack((events.x_px, events.y_px)))
        np.testing.assert_allclose(start_us + columns[:, 2] * 2000, events.t_us, atol=0.01)
        np.testing.assert_array_equal(columns[:, 3] > 0, events.on)
        np.testing.assert_allclose(sample["centre"], (at.u_px[0], at.v_px[0], at.r_px[0]), rtol=1e-6)
    with pytest.raises(IndexError):
        windows[len(windows)]


def test_all_windows_are_there_once_and_those_without_a_ball_on_demand(windows: EventWindows, folder: Path) -> None:
    every = EventWindows(folder, [SECOND], window_us=5000, every_us=2500, only_with_ball=False)
    with open_recording(folder / SECOND) as recording:
        expected = [
            (name, start) for name in recording.cameras for start in range(0, recording.duration_us - 4999, 2500)
        ]
    assert [(one["camera"], one["start_us"]) for one in map(every.__getitem__, range(len(every)))] == expected
    seen = [not np.isnan(every[number]["centre"]).any() for number in range(len(every))]
    assert any(seen) and not all(seen)
    every.close()
    assert all(not np.isnan(windows[number]["centre"]).any() for number in range(len(windows)))


@pytest.mark.parametrize("workers", [0, 2])
def test_a_loader_gives_the_same_batches_whatever_its_workers(folder: Path, workers: int) -> None:
    windows = EventWindows(folder, [FIRST])
    windows[0]
    loader = DataLoader(windows, batch_size=7, collate_fn=collate_windows, num_workers=workers)
    number = 0
    for events, centres in loader:
        for row in range(len(centres)):
            sample = windows[number]
            np.testing.assert_array_equal(events[events[:, 0] == row][:, 1:], sample["events"])
            np.testing.assert_array_equal(centres[row], sample["centre"])
            number += 1
    assert number == len(windows) > 50
    windows.close()


def test_pictures_count_every_event_where_it_is(windows: EventWindows) -> None:
    busy = sorted(range(len(windows)), key=lambda number: -len(windows[number]["events"]))[:3]
    events, _ = collate_windows([windows[number] for number in busy])
    pictures = count_pictures(events, 3, windows.sensor(busy[0]))
    assert pictures.shape == (3, 2, SENSOR.height_px, SENSOR.width_px)
    expected = torch.zeros_like(pictures)
    for window, x, y, _, on in events.tolist():
        expected[int(window), 0 if on > 0 else 1, int(y), int(x)] += 1
    assert torch.equal(pictures, expected) and pictures.sum() == len(events) > 0


def test_few_files_are_open_at_once_and_a_copy_opens_its_own(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_windows, "KEPT_OPEN", 1)
    opened: list[str] = []

    def counted(path: Path):
        opened.append(path.name)
        return open_recording(path)

    monkeypatch.setattr(event_windows, "open_recording", counted)
    windows = EventWindows(folder)
    assert opened == [FIRST, SECOND]
    for number in (-1, -2):
        assert windows[number]["recording"] == SECOND
    assert opened == [FIRST, SECOND]
    for number in (0, 1):
        assert windows[number]["recording"] == FIRST
    assert opened == [FIRST, SECOND, FIRST]
    copy = pickle.loads(pickle.dumps(windows))
    windows.close()
    np.testing.assert_array_equal(copy[0]["events"], windows[0]["events"])
    copy.close()
    windows.close()


def test_what_is_no_data_set_or_not_its_file_is_said(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="not a data set"):
        EventWindows(tmp_path)
    with pytest.raises(ConfigError, match="not in the index"):
        EventWindows(folder, ["nothing.h5"])
    with pytest.raises(ConfigError, match="1 us"):
        EventWindows(folder, window_us=0)
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / FIRST).write_bytes((folder / SECOND).read_bytes())
    with pytest.raises(RecordingError, match="not the recording of the index"):
        EventWindows(tmp_path)
