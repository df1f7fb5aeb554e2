"""What is written is read by somebody else's reader, and by our own import."""

import re
from pathlib import Path

import faery
import h5py
import numpy as np
import pytest

from app.export.events import export_csv, export_dsec, export_evt3
from app.export.formats import time_note
from app.export.selection import Span
from app.export.unfinished import ExportCancelledError
from core.errors import CommandError
from core.events import Events, SensorSize
from core.recordings import ImportOrder, import_recording, open_recording
from core.recordings.evt3_encoder import Evt3Encoder, evt3_header
from tests.app.export.tasks import task_of

SPAN = Span(100_500, 400_000)
EXPORTS = {"dsec": export_dsec, "evt3": export_evt3, "csv": export_csv}


@pytest.fixture(scope="module")
def recording(serve_recording: Path):
    with open_recording(serve_recording) as opened:
        yield opened


def same(events: Events, t, x, y, on) -> bool:
    pairs = ((events.t_us, t), (events.x_px, x), (events.y_px, y), (events.on, on))
    return len(events) > 10_000 and all(np.array_equal(a, b) for a, b in pairs)


def read_evt(path: Path) -> list[np.ndarray]:
    with faery.evt.Decoder(path, None, None) as decoder:
        assert decoder.version == "evt3"
        packets = [packet["events"] for packet in decoder if "events" in packet]
    return [np.concatenate([packet[name] for packet in packets]) for name in ("t", "x", "y", "on")]


def test_plain_h5py_reads_the_dsec_layout(recording, tmp_path) -> None:
    left, right = export_dsec(task_of(recording, tmp_path, SPAN))
    assert (left.name, right.name) == ("left.h5", "right.h5")
    with h5py.File(left) as file:
        t, x, y, p = (np.asarray(file[f"events/{name}"]) for name in "txyp")
        assert (t.dtype, x.dtype, p.dtype) == (np.uint32, np.uint16, np.uint8)
        assert same(recording.cameras["left"].slice(100_500, 400_000), t.astype(np.int64) + SPAN.start_us, x, y, p > 0)
        assert int(file["t_offset"][()]) == SPAN.start_us
        marks = np.asarray(file["ms_to_idx"])
        assert len(marks) == 300 and np.array_equal(marks, np.searchsorted(t, 1000 * np.arange(300)))


def test_faery_reads_the_evt3_file(recording, tmp_path) -> None:
    _, right = export_evt3(task_of(recording, tmp_path, SPAN))
    t, x, y, on = read_evt(right)
    assert same(recording.cameras["right"].slice(100_500, 400_000), t.astype(np.int64) + SPAN.start_us, x, y, on)


@pytest.mark.parametrize("name", ["evt3", "dsec"])
def test_the_report_says_by_how_much_an_import_of_the_files_is_shifted(recording, tmp_path, name) -> None:
    note = time_note(name, recording, SPAN)
    assert f"count from {SPAN.start_us} us" in note and time_note("csv", recording, SPAN) == ""
    shift_us = int(re.findall(r"add (\d+) us", note)[0])
    import_recording(ImportOrder(EXPORTS[name](task_of(recording, tmp_path, SPAN))), tmp_path / "again.h5")
    with open_recording(tmp_path / "again.h5") as again:
        back, original = (one.cameras["left"] for one in (again, recording))
        assert np.array_equal(back.slice(0, SPAN.length_us).t_us + shift_us, original.slice(100_500, 400_000).t_us)


def test_evt3_survives_a_silence_longer_than_its_clock(tmp_path) -> None:
    t = np.array([0, 5, 40_000_000, 40_000_001, 41_000_000])
    events = Events.from_columns(t, [0, 2, 1279, 7, 7], [0, 1, 719, 719, 0], [1, 0, 1, 1, 0], SensorSize(1280, 720))
    encoder = Evt3Encoder()
    path = tmp_path / "silence.raw"
    words = [encoder.encode(part) for part in (events.rows(slice(0, 3)), events.rows(slice(3, 5)))]
    path.write_bytes(evt3_header(events.sensor) + np.concatenate(words).tobytes())
    for column, expected in zip(read_evt(path), (t, events.x_px, events.y_px, events.on), strict=True):
        assert np.array_equal(column, expected)
    with open_recording(path) as back:
        again = next(iter(back.cameras.values()))
        assert again.sensor == events.sensor
        assert np.array_equal(again.slice(0, 50_000_000).t_us, t)


def test_the_tables_hold_every_event_and_the_truth(recording, tmp_path) -> None:
    files = export_csv(task_of(recording, tmp_path, SPAN))
    assert {path.name for path in files} == {
        "left.csv", "right.csv", "ground_truth_ball.csv", "ground_truth_left.csv", "ground_truth_right.csv"
    }  # fmt: skip
    table = np.loadtxt(tmp_path / "left.csv", delimiter=",", skiprows=1, dtype=np.int64)
    assert (tmp_path / "left.csv").open().readline() == "t_us,x_px,y_px,on\n"
    assert same(recording.cameras["left"].slice(100_500, 400_000), *table.T[:3], table[:, 3] > 0)
    ball = np.genfromtxt(tmp_path / "ground_truth_ball.csv", delimiter=",", names=True)
    inside = (recording.ball.t_us >= SPAN.start_us) & (recording.ball.t_us < SPAN.end_us)
    assert np.array_equal(ball["t_us"], recording.ball.t_us[inside])
    assert np.allclose(ball["p_world_m_2"], recording.ball.p_world_m[inside, 2])


@pytest.mark.parametrize("name", ["dsec", "evt3", "csv"])
def test_our_import_takes_the_files_back(name, recording, tmp_path) -> None:
    first = EXPORTS[name](task_of(recording, tmp_path, SPAN))[0]
    with open_recording(first, sensor=SensorSize(1280, 720)) as back:
        events = next(iter(back.cameras.values())).slice(0, 10**7)
    original = recording.cameras["left"].slice(SPAN.start_us, SPAN.end_us)
    assert np.array_equal(np.diff(events.t_us), np.diff(original.t_us))
    assert np.array_equal(events.x_px, original.x_px) and np.array_equal(events.on, original.on)


@pytest.mark.parametrize("name", ["dsec", "evt3", "csv"])
def test_an_export_that_is_cancelled_leaves_nothing(name, recording, tmp_path) -> None:
    asked = iter([False] * 4 + [True] * 99)
    with pytest.raises(ExportCancelledError):
        EXPORTS[name](task_of(recording, tmp_path / "out", SPAN, cancelled=lambda: next(asked)))
    assert list((tmp_path / "out").iterdir()) == []


def test_what_exists_is_kept_unless_told_otherwise(recording, tmp_path) -> None:
    (tmp_path / "right.raw").write_text("mine")
    with pytest.raises(CommandError, match="exists already"):
        export_evt3(task_of(recording, tmp_path, SPAN))
    assert [path.name for path in tmp_path.iterdir()] == ["right.raw"]
    export_evt3(task_of(recording, tmp_path, SPAN, overwrite=True))
    assert (tmp_path / "right.raw").read_bytes().startswith(b"% evt 3.0\n")
