"""The Croissant card says what the files are; mlcroissant validates and reads it where it is installed."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from core.data_sets import plan_data_set, run_data_set
from core.data_sets.croissant import CROISSANT
from core.data_sets.index import INDEX, SCHEMA, read_index
from core.data_sets.plan import Making
from core.events import SensorSize
from core.jobs import ALONE

SMALL = Making(sensor=SensorSize(48, 32), wall=0.7)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    plan = plan_data_set(speeds_mps=(8, 9), recordings_per=1, serves=1, robot=False, seed=3, making=SMALL)
    run_data_set(plan, folder, engine=ALONE)
    return folder


@pytest.fixture(scope="module")
def card(made: Path) -> dict:
    return json.loads((made / CROISSANT).read_text(encoding="utf-8"))


def test_every_file_is_named_with_its_hash_and_size(made: Path, card: dict) -> None:
    files = {item["@id"]: item for item in card["distribution"]}
    assert set(files) == {INDEX, "ball-8mps-side-1.h5", "ball-9mps-side-1.h5"}
    for name, item in files.items():
        data = (made / name).read_bytes()
        assert item["sha256"] == hashlib.sha256(data).hexdigest()
        assert item["contentSize"] == f"{len(data)} B"
        assert item["contentUrl"] == name


def test_the_fields_are_the_plain_columns_of_the_index(card: dict) -> None:
    (records,) = card["recordSet"]
    fields = {field["source"]["extract"]["column"]: field for field in records["field"]}
    assert set(SCHEMA.names) - set(fields) == {"scene_changes", "cameras"}  # tables within the table
    assert fields["events"]["dataType"] == "sc:Integer"
    assert fields["noise_hz"]["dataType"] == "sc:Float"
    assert fields["speeds_mps"]["dataType"] == "sc:Float" and fields["speeds_mps"]["repeated"] is True
    assert all(field["source"]["fileObject"] == {"@id": INDEX} for field in fields.values())
    assert card["conformsTo"] == "http://mlcommons.org/croissant/1.0"


def test_mlcroissant_accepts_the_card_and_reads_the_records(made: Path) -> None:
    croissant = pytest.importorskip("mlcroissant", reason="its package could not be installed")
    data_set = croissant.Dataset(jsonld=str(made / CROISSANT))
    assert not data_set.metadata.ctx.issues.errors
    records = list(data_set.records(record_set="recordings"))
    expected = read_index(made).to_pylist()
    assert [record["recordings/file"].decode() for record in records] == [row["file"] for row in expected]
    assert [int(record["recordings/events"]) for record in records] == [row["events"] for row in expected]
