"""The index of a data set opens in what people use for tables, and says what the files are."""

import hashlib
import json
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from pyarrow import parquet

from core.data_sets import MANIFEST, plan_data_set, run_data_set
from core.data_sets import run as run_module
from core.data_sets.facts import file_sha256
from core.data_sets.index import INDEX, read_index
from core.data_sets.plan import Making
from core.errors import RecordingError
from core.events import SensorSize
from core.jobs import ALONE
from core.recordings import open_recording

SMALL = Making(sensor=SensorSize(48, 32), wall=0.7)


def plan(serves: int):
    return plan_data_set(speeds_mps=(8, 9), recordings_per=serves, serves=1, robot=False, seed=3, making=SMALL)


@pytest.fixture
def made(tmp_path: Path) -> Path:
    run_data_set(plan(1), tmp_path, engine=ALONE)
    return tmp_path


def test_every_row_is_true_of_its_file(made: Path) -> None:
    rows = read_index(made).to_pylist()
    assert [row["file"] for row in rows] == ["ball-8mps-side-1.h5", "ball-9mps-side-1.h5"]
    for row, speed in zip(rows, (8.0, 9.0), strict=True):
        data = (made / row["file"]).read_bytes()
        assert row["sha256"] == hashlib.sha256(data).hexdigest() and row["bytes"] == len(data)
        assert (row["scene"], row["placement"], row["speeds_mps"]) == ("ball", "side", [speed])
        assert (row["robot"], row["sensor"], dict(row["scene_changes"])) == (False, "48x32", {"wall": 0.7})
        with open_recording(made / row["file"]) as recording:
            events = {name: stream.event_count for name, stream in recording.cameras.items()}
            assert row["uuid"] == recording.uuid and row["duration_us"] == recording.duration_us
            assert {camera["name"]: camera["events"] for camera in row["cameras"]} == events
            assert row["events"] == sum(events.values()) > 0


def test_pandas_polars_and_duckdb_ask_it(made: Path) -> None:
    path, expected = made / INDEX, read_index(made).to_pylist()[1]
    frame = pd.read_parquet(path)
    assert frame[frame.events == expected["events"]].file.tolist() == [expected["file"]]
    fast = pl.scan_parquet(path).filter(pl.col("speeds_mps").list.max() > 8.5).select("uuid", "seed").collect()
    assert fast.rows() == [(expected["uuid"], expected["seed"])]
    asked = f"from (select file, speeds_mps, unnest(cameras) as camera from '{path}') where 9.0 = any(speeds_mps)"
    centres = {camera["name"]: camera["centres"] for camera in expected["cameras"]}
    with duckdb.connect() as database:
        answer = database.execute(f"select file, camera.name, camera.centres {asked}").fetchall()
    assert answer == [(expected["file"], name, centres[name]) for name in ("left", "right")]


def test_a_longer_plan_adds_rows_and_makes_nothing_again(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = {path.name: path.stat().st_mtime_ns for path in made.glob("*.h5")}
    rows = {row["file"]: row for row in read_index(made).to_pylist()}
    hashed: list[str] = []

    def counted(path: Path) -> str:
        hashed.append(path.name)
        return file_sha256(path)

    monkeypatch.setattr(run_module, "file_sha256", counted)
    monkeypatch.setattr("core.data_sets.facts.file_sha256", counted)
    done = run_data_set(plan(2), made, engine=ALONE)
    assert set(done.kept) == {"ball-8mps-side-1", "ball-9mps-side-1"} and len(done.made) == 2
    assert sorted(hashed) == sorted(f"{name}.h5" for name in done.made), "what was hashed is not hashed again"
    after = {row["file"]: row for row in read_index(made).to_pylist()}
    assert rows.items() <= after.items() and len(after) == 4
    assert before.items() <= {path.name: path.stat().st_mtime_ns for path in made.glob("*.h5")}.items()
    (made / MANIFEST).write_text(json.dumps({"format": "damaged"}))
    run_data_set(plan(2), made, engine=ALONE)
    assert {row["file"]: row for row in read_index(made).to_pylist()} == after, "computed again where it is not known"


def test_the_card_of_many_is_not_written_after_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[int] = []
    write_card = run_module.write_card

    def slow(folder: Path, plan, facts) -> dict[str, object]:
        written.append(len(facts))
        now[0] += 1.0
        return write_card(folder, plan, facts)

    now = [0.0]
    monkeypatch.setattr(run_module, "write_card", slow)
    monkeypatch.setattr(run_module.time, "monotonic", lambda: now[0])
    run_data_set(plan(2), tmp_path, engine=ALONE)
    assert written == [0, 4], "a card that takes a second is due after twenty"
    assert read_index(tmp_path).num_rows == 4


@pytest.mark.parametrize("damage", ["gone", "cut", "foreign", "retyped", "empty cell", "elsewhere", "twice"])
def test_an_index_that_is_none_is_told_in_one_line(made: Path, damage: str) -> None:
    path = made / INDEX
    table = read_index(made)
    if damage == "gone":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:-20])
    elif damage == "foreign":
        parquet.write_table(pa.table({"file": ["a"]}), path)
    elif damage == "twice":
        parquet.write_table(pa.concat_tables([table, table]), path)
    elif damage in ("empty cell", "elsewhere"):
        names = pa.array(["../secret.h5" if damage == "elsewhere" else None] * len(table))
        parquet.write_table(table.set_column(0, "file", names), path)
    else:
        retyped = table.set_column(table.schema.get_field_index("seed"), "seed", pa.array(["many"] * len(table)))
        parquet.write_table(retyped, path)
    with pytest.raises(RecordingError, match=r"index\b|data set") as told:
        read_index(made)
    assert "\n" not in str(told.value)
