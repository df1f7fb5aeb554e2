"""The ball index as a table: stored and read back, stale after a change, filtered by its columns."""

from __future__ import annotations

from pathlib import Path

import duckdb
import numpy as np
import polars
import pyarrow as pa
import pytest

from core.errors import ConfigError
from labels.balls.rows import BallRow
from labels.balls.table import (
    COLUMNS,
    joined,
    parse_conditions,
    read_rows,
    select_rows,
    stamp_of,
    table_of,
    write_rows,
)

ROWS = [
    BallRow(kind="flight", number=1, t_us=2**53 + 1, end_us=2**53 + 9, speed_mps=5.0, outcome="net", method="truth"),
    BallRow(kind="stroke", number=1, t_us=7, speed_mps=6.5, error_m=0.2, outcome="returned", method="truth"),
    BallRow(kind="stroke", number=2, speed_mps=9.0, spin_radps=50.0, spin_sigma_radps=3.0, method="ddpg"),
]


def table() -> pa.Table:
    return joined([("recording", "a b", table_of(ROWS), np.array([0, 2, 0])), ("run", "r", table_of([]), np.zeros(0))])


def selected(text: str) -> list[int]:
    return select_rows(table(), parse_conditions(text)).tolist()


def test_what_is_stored_is_read_by_us_and_by_others(tmp_path: Path) -> None:
    source, stored = tmp_path / "a.h5", tmp_path / "cache" / "a.parquet"
    source.write_bytes(b"abc")
    write_rows(stored, table_of(ROWS), stamp_of(source, "the-uuid", tracked=True))
    found = read_rows(stored)
    assert found is not None and found[0].equals(table_of(ROWS))
    assert (found[1].uuid, found[1].tracked, found[1].same_file(source)) == ("the-uuid", True, True)
    assert polars.read_parquet(stored)["t_us"].to_list() == [2**53 + 1, 7, None]
    counted = duckdb.sql(f"SELECT count(*), avg(speed_mps) FROM '{stored}' WHERE kind = 'stroke'").fetchall()
    assert counted == [(2, 7.75)]


def test_a_changed_source_or_a_damaged_file_makes_the_rows_anew(tmp_path: Path) -> None:
    source, stored = tmp_path / "a.h5", tmp_path / "a.parquet"
    source.write_bytes(b"abc")
    stamp = stamp_of(source)
    write_rows(stored, table_of(ROWS), stamp)
    source.write_bytes(b"abcd")
    assert not stamp.same_file(source)
    assert read_rows(tmp_path / "none.parquet") is None
    stored.write_bytes(stored.read_bytes()[:-20])
    assert read_rows(stored) is None
    pa.parquet.write_table(pa.table({"x": [1]}), stored)
    assert read_rows(stored) is None


def test_the_joined_table_has_all_columns_in_order() -> None:
    assert tuple(table().column_names) == COLUMNS
    assert len(joined([])) == 0 and tuple(joined([]).column_names) == COLUMNS


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("", [0, 1, 2]),
        ("kind=stroke", [1, 2]),
        ("speed_mps=6.5..", [1, 2]),
        ("speed_mps=..6.5", [0, 1]),
        ("speed_mps=6..7 kind=flight|stroke", [1]),
        ("outcome=net|returned", [0, 1]),
        ("spin_radps=..", [2]),
        ("number=2", [2]),
        ("t_us=5..59507442", [1]),
        ("t_us=59507442.. number=..3", [0]),
        ("labels=1..", [1]),
        ("name='a b' error_m=..1", [1]),
        ("name=r", []),
    ],
)
def test_conditions_select_rows_and_what_is_unknown_meets_none(text: str, rows: list[int]) -> None:
    assert selected(text) == rows
    again = " ".join(f"'{one}'" for one in parse_conditions(text))
    assert selected(again) == rows


@pytest.mark.parametrize("text", ["speed=5", "speed_mps", "speed_mps=", "speed_mps=a..b", "name='a", "kind=flight =2"])
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="got"):
        parse_conditions(text)
