"""The index of a workspace's balls: what is stored is read until its source changes; what cannot be read is named."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.shared.ball_index import CACHE, BallIndex, ball_sources, index_balls, moved_rows
from core.data_sets import MANIFEST
from core.events import SensorSize
from core.recordings import BallTruth, RecordingWriter, open_recording
from labels.model import ContactKind, ContactLabel, Label, LabelState
from labels.store import LabelStore

RUNS = Path(__file__).parents[2] / "fixtures" / "written-by-0.1" / "runs"


def write_recording(path: Path, speeds_mps: tuple[float, ...] = (5.0,)) -> Path:
    """Balls along x, 100 ms each and 100 ms apart; with no speeds a recording that says nothing of a ball."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with RecordingWriter(path, {"left": SensorSize(32, 24)}, overwrite=True) as writer:
        t = np.arange(0, 100_000, 1000)
        for number, speed in enumerate(speeds_mps):
            p, v = (np.outer(values, [1.0, 0, 0]) for values in (speed * 1e-6 * t - 0.1, np.full(len(t), speed)))
            part = BallTruth(
                t + 200_000 * number, p + np.array([0, 0, 0.3]), v, np.zeros_like(p), np.ones(len(t), np.bool_)
            )
            writer.write_ball(part)
        writer.extend_duration(1_000_000)
    return path


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Two recordings, one that knows no ball, one of a data set, and a run."""
    write_recording(tmp_path / "recordings" / "one.h5", (5.0, 6.0))
    write_recording(tmp_path / "recordings" / "two.h5", (7.0,))
    write_recording(tmp_path / "recordings" / "unknown.h5", ())
    write_recording(tmp_path / "set" / "made.h5", (8.0,))
    (tmp_path / "set" / MANIFEST).write_text("{}")
    shutil.copytree(RUNS / "ddpg", tmp_path / "runs" / "ddpg", ignore=shutil.ignore_patterns("seed-1"))
    return tmp_path


def index(place: Path) -> BallIndex:
    return index_balls(ball_sources(place), place)


def test_recordings_data_sets_and_runs_are_in_one_table(workspace: Path) -> None:
    found = index(workspace)
    named = {(source.kind, source.name) for source in found.sources}
    assert named == {
        ("recording", "one"), ("recording", "two"), ("recording", "unknown"), ("data set", "made"),
        ("run", "ddpg/seed-0"),
    }  # fmt: skip
    speeds = found.table.column("speed_mps").to_pylist()
    assert {5.0, 6.0, 7.0, 8.0} <= set(speeds)
    assert [source.name for source in found.unknown] == ["unknown"] and found.failed == {}
    for row, name in enumerate(found.table.column("name").to_pylist()):
        assert found.source_of(row).name == name


def test_only_what_has_changed_is_indexed_again(workspace: Path) -> None:
    first = index(workspace)
    assert (first.made, index(workspace).made) == (5, 0)
    assert index(workspace).table.equals(first.table)
    path = write_recording(workspace / "recordings" / "two.h5", (9.0,))
    again = index(workspace)
    assert again.made == 1 and 9.0 in again.table.column("speed_mps").to_pylist()
    os.utime(path, ns=(1, 1))
    assert index(workspace).made == 1
    shutil.rmtree(workspace / CACHE)  # derived: nothing is lost with it
    assert index(workspace).table.equals(again.table)


def test_what_cannot_be_read_is_named_and_the_rest_is_there(workspace: Path) -> None:
    (workspace / "recordings" / "two.h5").write_bytes(b"not a recording")
    found = index(workspace)
    assert list(found.failed) == [str(workspace / "recordings" / "two.h5")]
    assert {5.0, 8.0} <= set(found.table.column("speed_mps").to_pylist())


def test_it_reports_its_progress_and_stops_when_cancelled(workspace: Path) -> None:
    shares: list[float] = []
    index_balls(ball_sources(workspace), workspace, progress=shares.append, cancelled=lambda: len(shares) == 2)
    assert shares == [0.2, 0.4]
    assert len(list((workspace / CACHE).iterdir())) == 2


def test_a_recording_alone_or_a_run_alone_needs_no_workspace(workspace: Path) -> None:
    for place, rows in ((workspace / "set", 1), (workspace / "recordings" / "one.h5", 2)):
        assert len(index_balls(ball_sources(place)).table) == rows
    assert {one.kind for one in ball_sources(workspace / "runs" / "ddpg")} == {"run"}
    assert not (workspace / CACHE).exists()


def test_labels_are_counted_in_the_flight_and_contacts_at_the_contact(workspace: Path) -> None:
    with open_recording(workspace / "recordings" / "one.h5") as recording:
        uuid = recording.uuid
    index(workspace)
    with LabelStore.open(workspace / "labels", uuid, "left", "anna", tool="t") as store:
        for t_us in (0, 50_000, 150_000, 250_000):
            store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=1.0, y_px=2.0))
        store.edit(put_contacts=[ContactLabel(t_us=50_000, kind=ContactKind.BOUNCE)])
    found = index(workspace)  # of the stored rows: labels are no part of them
    assert found.made == 0
    rows = [row for row in found.table.to_pylist() if row["name"] == "one"]
    assert [(row["kind"], row["labels"]) for row in rows] == [("flight", 2), ("flight", 1)]


def test_selected_rows_are_found_again_after_a_source_came_before_them_and_one_changed(workspace: Path) -> None:
    before = index(workspace)
    names = before.table.column("name").to_pylist()
    rows = np.array([names.index("one") + 1, names.index("two")])
    write_recording(workspace / "recordings" / "a.h5", (4.0,))
    write_recording(workspace / "recordings" / "two.h5", (7.0, 7.5))
    after = index(workspace)
    moved = moved_rows(rows, before, after)
    assert moved is not None
    assert after.table.take(moved).to_pylist() == before.table.take(rows[:1]).to_pylist()
    assert moved_rows(rows[1:], before, after) is None
