"""A data set of selected flights: what is cut, by whose centres, what is left out, and nothing after a cancel."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from app.export.flight_set import AGAIN, IN_RUN, UNKNOWN, FlightSet, write_flight_set
from app.export.unfinished import ExportCancelledError
from app.shared.ball_index import BallIndex, ball_sources, index_balls
from core.data_sets import CARD, EventWindows, read_manifest
from core.data_sets.croissant import CROISSANT
from core.errors import CommandError
from core.recordings import RecordingWriter, open_recording
from core.recordings.layout import BALL_GROUP
from labels.model import Label, LabelState, PositionSource, Provenance
from labels.store import LabelStore
from tests.app.shared.test_ball_index import RUNS, write_recording


@pytest.fixture
def workspace(tmp_path: Path, serve_recording: Path) -> Path:
    (tmp_path / "recordings").mkdir()
    shutil.copy(serve_recording, tmp_path / "recordings" / "serve.h5")
    return tmp_path


def index(place: Path) -> BallIndex:
    return index_balls(ball_sources(place), place)


def write(found: BallIndex, place: Path, rows: list[int] | None = None, name: str = "set", **options) -> FlightSet:
    chosen = np.arange(len(found.table)) if rows is None else np.array(rows, np.int64)
    options = {"selected_by": "all balls", **options}
    return write_flight_set(found, chosen, place / "labels", place / "exports" / name, **options)


def label(place: Path, times_us: list[int], camera: str = "left", annotator: str = "ann") -> None:
    with open_recording(place / "recordings" / "serve.h5") as recording:
        uuid = recording.uuid
    made = Provenance(source=PositionSource.ACCEPTED)
    with LabelStore.open(place / "labels", uuid, camera, annotator) as store:
        for t_us in times_us:
            store.put(Label(t_us=t_us, state=LabelState.VISIBLE, x_px=100.0, y_px=50.0, r_px=9.0, provenance=made))


def test_only_the_span_of_the_flight_is_cut_with_its_truth(workspace) -> None:
    found = index(workspace)
    bounce = found.table.column("kind").to_pylist().index("bounce")
    made = write(found, workspace, [bounce], selected_by="conditions kind=bounce")
    (row,) = pq.read_table(made.folder / "index.parquet").to_pylist()
    flight = found.table.to_pylist()[found.table.column("kind").to_pylist().index("flight")]
    assert (row["recording"], row["start_us"], row["end_us"]) == ("serve", flight["t_us"], flight["end_us"])
    assert row["found_by"] == "truth" and dict(row["centres_by"]) == {"left": "truth", "right": "truth"}
    with (
        open_recording(workspace / "recordings" / "serve.h5") as whole,
        open_recording(made.folder / row["file"]) as cut,
    ):
        assert cut.duration_us == row["end_us"] - row["start_us"] == row["duration_us"]
        for name, stream in cut.cameras.items():
            expected = whole.cameras[name].slice(row["start_us"], row["end_us"])
            events = stream.slice(0, cut.duration_us)
            assert np.array_equal(events.t_us + row["start_us"], expected.t_us)
            assert np.array_equal(events.x_px, expected.x_px)
            there, before = stream.truth.at([100_000]), whole.cameras[name].truth.at([row["start_us"] + 100_000])
            assert np.array_equal(there.u_px, before.u_px, equal_nan=True)
        assert cut.cameras["left"].calibration is not None and cut.read_rows(BALL_GROUP) is not None
    windows = EventWindows(made.folder)
    assert len(windows) and not np.isnan(windows[0]["centre"]).any()
    card = (made.folder / CARD).read_text()
    assert "Selected by: conditions kind=bounce." in card and "| truth | 1 |" in card and "Left out" not in card
    assert read_manifest(made.folder)["selection"]["splits"] == {"training": 1, "validation": 0, "test": 0}
    croissant = json.loads((made.folder / CROISSANT).read_text())
    assert "Flights: 1. Recordings: 1. Selected by: conditions kind=bounce." in croissant["description"]


def test_labels_of_a_person_stand_in_place_of_the_truth_and_are_named(workspace) -> None:
    label(workspace, [200_000, 202_000, 204_000])
    label(workspace, [300_000], annotator="bea")
    made = write(index(workspace), workspace)
    (entry,) = read_manifest(made.folder)["recordings"]
    assert entry["flight"]["centres_by"] == {"left": "labels of ann", "right": "truth"}
    assert entry["flight"]["label_sources"] == {"accepted": 3}
    assert entry["cameras"]["left"]["centres"] == 3
    card = (made.folder / CARD).read_text()
    assert "3 accepted" in card and "| labels of annotators who labelled less of a flight" in card
    windows = EventWindows(made.folder, window_us=2_000, every_us=500)
    left = [one for one in map(windows.__getitem__, range(len(windows))) if one["camera"] == "left"]
    times = {one["start_us"] + 1_000 + entry["flight"]["start_us"] for one in left}
    assert times and min(times) >= 200_000 and max(times) <= 204_000
    assert {tuple(one["centre"].tolist()) for one in left} == {(100.0, 50.0, 9.0)}
    sparse = EventWindows(made.folder, at_samples=True)
    first = [one for one in map(sparse.__getitem__, range(3)) if one["camera"] == "left"]
    assert [one["start_us"] + 1_000 + entry["flight"]["start_us"] for one in first] == [200_000, 202_000, 204_000]


def test_what_nobody_knows_and_balls_of_runs_are_left_out_and_counted(workspace) -> None:
    path = workspace / "recordings" / "unknown.h5"
    with open_recording(workspace / "recordings" / "serve.h5") as recording:
        sensors = {name: stream.sensor for name, stream in recording.cameras.items()}
    predictions = {
        "t_us": np.array([10_000, 20_000]), "t_hit_us": np.array([90_000, 90_000]), "v_hit_mps": np.full((2, 3), 4.0),
        "stage": np.array([b"pre"] * 2), "p_hit_m": np.zeros((2, 3)), "cov": np.zeros((2, 6, 6)),
    }  # fmt: skip
    with RecordingWriter(path, sensors) as writer:
        writer.append_rows("/predictions", predictions)
        writer.extend_duration(100_000)
    shutil.copytree(RUNS / "ddpg", workspace / "runs" / "ddpg", ignore=shutil.ignore_patterns("seed-1"))
    found = index(workspace)
    in_runs = sum(kind == "run" for kind in found.table.column("source").to_pylist())
    made = write(found, workspace)
    assert read_manifest(made.folder)["selection"]["left_out"] == {UNKNOWN: 1, IN_RUN: in_runs}
    assert f"left out: 1 {UNKNOWN}" in str(made) and str(made).startswith("1 flight (")
    names = found.table.column("name").to_pylist()
    with pytest.raises(CommandError, match="1 flights without labels and without truth"):
        write(found, workspace, [names.index("unknown")], "other")
    assert not (workspace / "exports" / "other").exists()


def test_a_flight_and_its_copy_in_a_data_set_are_one(workspace) -> None:
    label(workspace, [200_000])
    made = write(index(workspace), workspace)
    shutil.copytree(made.folder, workspace / "recordings" / "set")
    again = write(index(workspace), workspace, name="again")
    assert read_manifest(again.folder)["selection"]["left_out"] == {AGAIN: 1}
    (copy,) = ball_sources(workspace / "recordings" / "set")
    alone = write(index_balls([copy]), workspace, name="alone")
    first, second = (read_manifest(one.folder)["recordings"][0] for one in (made, alone))
    assert second["flight"]["centres_by"]["left"] == "labels of ann", "not the truth of a simulation"
    assert second["flight"]["start_us"] == first["flight"]["start_us"]


def test_a_name_is_taken_once_and_a_cancel_leaves_nothing(workspace) -> None:
    found = index(workspace)
    with pytest.raises(ExportCancelledError):
        write(found, workspace, cancelled=lambda: True)
    shares: list[float] = []
    with pytest.raises(ExportCancelledError):
        write(found, workspace, progress=shares.append, cancelled=lambda: len(shares) > 1)
    assert shares and list((workspace / "exports").iterdir()) == []
    made = write(found, workspace, progress=shares.append)
    assert shares[-1] == pytest.approx(1.0)
    with pytest.raises(CommandError, match="exists already"):
        write(found, workspace)
    assert made.folder.is_dir()


def test_the_true_ball_in_the_world_is_enough(tmp_path) -> None:
    write_recording(tmp_path / "recordings" / "one.h5", (5.0, 6.0, 7.0))
    made = write(index(tmp_path), tmp_path)
    entries = read_manifest(made.folder)["recordings"]
    assert {one["flight"]["split"] for one in entries} == {"training", "validation", "test"}
    assert all(one["points_3d"] > 90 and one["flight"]["centres_by"] == {} for one in entries)
    assert "| 3D truth only | 3 | 0 |" in (made.folder / CARD).read_text()


def test_mlcroissant_accepts_the_card_of_flights(tmp_path) -> None:
    croissant = pytest.importorskip("mlcroissant", reason="its package could not be installed")
    write_recording(tmp_path / "recordings" / "one.h5", (5.0, 6.0, 7.0))
    made = write(index(tmp_path), tmp_path)
    data_set = croissant.Dataset(jsonld=str(made.folder / CROISSANT))
    assert not data_set.metadata.ctx.issues.errors
    records = list(data_set.records(record_set="recordings"))
    assert {one["recordings/split"] for one in records} == {b"training", b"validation", b"test"}
