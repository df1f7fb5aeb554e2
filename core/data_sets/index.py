"""The index of a data set: one Parquet row per recording, for pandas, polars, DuckDB and whoever trains on it."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import pyarrow as pa
from pyarrow import parquet

from core.errors import RecordingError
from core.files import replace_file

INDEX: Final = "index.parquet"
CAMERA: Final = ("events", "centres", "frames", "frames_with_ball", "delayed", "dropped")
SUMS: Final = ("events", "centres", "frames", "frames_with_ball")
"""Columns that hold the sum over all cameras."""
SCHEMA: Final = pa.schema(
    [
        ("file", pa.string()),
        ("uuid", pa.string()),
        ("sha256", pa.string()),
        ("bytes", pa.int64()),
        ("duration_us", pa.int64()),
        ("scene", pa.string()),
        ("scene_changes", pa.map_(pa.string(), pa.float64())),
        ("placement", pa.string()),
        ("speeds_mps", pa.list_(pa.float64())),
        ("robot", pa.bool_()),
        ("seed", pa.int64()),
        ("sensor", pa.string()),
        ("noise_hz", pa.float64()),
        ("physics", pa.string()),
        ("events", pa.int64()),
        ("centres", pa.int64()),
        ("frames", pa.int64()),
        ("frames_with_ball", pa.int64()),
        ("points_3d", pa.int64()),
        ("points_3d_seen", pa.int64()),
        ("episodes", pa.int64()),
        ("returned", pa.int64()),
        ("racket_poses", pa.int64()),
        ("cameras", pa.list_(pa.struct([("name", pa.string()), *((one, pa.int64()) for one in CAMERA)]))),
    ]
)
FLIGHT_SCHEMA: Final = pa.schema(
    [
        ("split", pa.string()),
        ("recording", pa.string()),
        ("recording_uuid", pa.string()),
        ("ball", pa.int64()),
        ("start_us", pa.int64()),
        ("end_us", pa.int64()),
        ("found_by", pa.string()),
        ("centres_by", pa.map_(pa.string(), pa.string())),
    ]
)
"""Further columns of a data set of flights, see `cut_flights.CutFlight`. A reader of data sets needs none of them."""


def schema_of(manifest: Mapping[str, object]) -> pa.Schema:
    """Columns of the index of a data set with this manifest."""
    return pa.schema([*SCHEMA, *FLIGHT_SCHEMA]) if "selection" in manifest else SCHEMA


def write_index(folder: Path, manifest: Mapping[str, object]) -> None:
    """Write the index beside the manifest that it is made of; the same manifest gives the same bytes."""
    entries = manifest["recordings"]
    assert isinstance(entries, list)
    schema = schema_of(manifest)
    table = pa.Table.from_pylist([_row(entry, schema.names) for entry in entries], schema)
    buffer = io.BytesIO()
    parquet.write_table(table, buffer, compression="zstd")
    replace_file(folder / INDEX, buffer.getvalue(), durable=True)


def read_index(folder: Path) -> pa.Table:
    """The rows of a data set, one per recording.

    Raises:
        RecordingError: if there is no index, it is damaged, or it lacks a column.
    """
    path = folder / INDEX
    remedy = "the `simulate` command that made the data set writes it again, and makes no recording anew"
    try:
        with parquet.ParquetFile(path) as file:
            table = file.read()
    except (OSError, ValueError, pa.ArrowException) as error:
        raise RecordingError("not a data set", expected=f"a folder with {INDEX}", where=path, remedy=remedy) from error
    try:
        table = table.select(SCHEMA.names).cast(SCHEMA)
        table.validate(full=True)
        files = table.column("file").to_pylist()
    except (KeyError, ValueError, pa.ArrowException) as error:
        got = " ".join(str(error).split())[:120]
        raise RecordingError("not an index of a data set", where=path, got=got, remedy=remedy) from error
    if empty := [name for name in SCHEMA.names if table.column(name).null_count]:
        raise RecordingError("the index is damaged", got=f"no {empty[0]} in a row", where=path, remedy=remedy)
    # The index may be a stranger's: no name leads out of its folder.
    if foreign := [name for name in files if not name.endswith(".h5") or Path(name).name != name or "\0" in name]:
        raise RecordingError("the index names a file elsewhere", got=repr(foreign[0][:80]), where=path, remedy=remedy)
    if len(set(files)) < len(files):
        raise RecordingError("the index names a file twice", where=path, remedy=remedy)
    return table


def _row(entry: Mapping, columns: list[str]) -> dict[str, object]:
    settings, cameras = entry["settings"], entry["cameras"]
    sums = {one: sum(camera[one] for camera in cameras.values()) for one in SUMS}
    named = [{"name": name, **camera} for name, camera in cameras.items()]
    flight = entry.get("flight", {})
    row = {**settings, **entry, **flight, **sums, "cameras": named}
    row["scene_changes"] = list(settings["scene_changes"].items())
    row["centres_by"] = list(flight.get("centres_by", {}).items())
    # JSON has no nan, and a column of the index no null.
    row["noise_hz"] = math.nan if row["noise_hz"] is None else row["noise_hz"]
    return {name: row[name] for name in columns}
