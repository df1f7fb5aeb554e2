"""The ball index as a table: stored as Parquet, and filtered by ranges of its columns.

It is derived: what is stored names the size and the time of change of its source, and is made again when they differ.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from core.errors import ConfigError
from core.files import replace_file
from core.text import parse_json
from labels.balls.rows import BallRow

VERSION: Final = 2
"""Version of the rows: what an earlier one made is made again."""
STAMP: Final = b"rallyscope"
INTEGERS: Final = ("number", "t_us", "end_us", "labels")
STATE: Final = ("x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps", "wx_radps", "wy_radps", "wz_radps")
"""The nine numbers of `BallRow.state`."""
NUMBERS: Final = ("speed_mps", "spin_radps", "spin_sigma_radps", "net_z_m", "error_m", *STATE)
SCALARS: Final = tuple(one.name for one in dataclasses.fields(BallRow) if one.name != "state")
ROW_COLUMNS: Final = (*SCALARS, *STATE)
COLUMNS: Final = ("source", "name", *SCALARS, "labels", *STATE)
"""`source`: recording, data set or run; `name`: of the recording or the run; `labels`: of a person, in this event."""


def _type(name: str) -> pa.DataType:
    return pa.int64() if name in INTEGERS else pa.float64() if name in NUMBERS else pa.string()


ROW_SCHEMA: Final = pa.schema([(name, _type(name)) for name in ROW_COLUMNS])
SCHEMA: Final = pa.schema([(name, _type(name)) for name in COLUMNS])


@dataclass(frozen=True, slots=True)
class SourceStamp:
    """What tells whether stored rows are still those of their source."""

    uuid: str
    """Identity of the recording; "" for a run."""
    bytes: int
    changed_ns: int
    tracked: bool = False
    """Whether the rows are from the tracker; without it an empty table means that nothing is stored."""
    version: int = VERSION

    def same_file(self, path: Path) -> bool:
        """Whether a file has this size and time of change: with them its uuid is the same."""
        status = path.stat()
        return (self.bytes, self.changed_ns, self.version) == (status.st_size, status.st_mtime_ns, VERSION)


def stamp_of(path: Path, uuid: str = "", *, tracked: bool = False) -> SourceStamp:
    """The stamp of a file as it is now."""
    status = path.stat()
    return SourceStamp(uuid, status.st_size, status.st_mtime_ns, tracked)


def table_of(rows: Sequence[BallRow]) -> pa.Table:
    """The rows of one source, in order; what is not known is null."""
    columns = {}
    for name in ROW_COLUMNS:
        at = STATE.index(name) if name in STATE else None
        values = [getattr(row, name) if at is None else row.state[at] for row in rows]
        known = [None if value == "" or (isinstance(value, float) and math.isnan(value)) else value for value in values]
        columns[name] = pa.array(known, _type(name))
    return pa.table(columns, ROW_SCHEMA)


def write_rows(path: Path, table: pa.Table, stamp: SourceStamp) -> None:
    """Store the rows of one source.

    Raises:
        OSError: if the disk refuses.
    """
    marked = table.replace_schema_metadata({STAMP: json.dumps(dataclasses.asdict(stamp)).encode()})
    buffer = io.BytesIO()
    parquet.write_table(marked, buffer, compression="zstd")
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, buffer.getvalue(), durable=False)


def read_rows(path: Path) -> tuple[pa.Table, SourceStamp] | None:
    """Stored rows and their stamp; None where there are none, or not of this version: they are made again."""
    try:
        with parquet.ParquetFile(path) as file:
            table = file.read()
        stamp = SourceStamp(**parse_json((table.schema.metadata or {})[STAMP]))
        return table.select(ROW_SCHEMA.names).cast(ROW_SCHEMA).replace_schema_metadata(), stamp
    except (OSError, KeyError, TypeError, ValueError, pa.ArrowException):
        return None


def joined(parts: Sequence[tuple[str, str, pa.Table, NDArray[np.int64]]]) -> pa.Table:
    """One table of those of many sources, each with its source, its name and its numbers of labels."""
    tables = []
    for source, name, table, labels in parts:
        columns = {column: table.column(column) for column in ROW_COLUMNS}
        columns |= {
            one: pa.array([text] * len(table), pa.string()) for one, text in (("source", source), ("name", name))
        }
        columns["labels"] = pa.array(labels, pa.int64())
        tables.append(pa.table({column: columns[column] for column in COLUMNS}, SCHEMA))
    return pa.concat_tables(tables).combine_chunks() if tables else SCHEMA.empty_table()


@dataclass(frozen=True, slots=True)
class BallCondition:
    """Condition on one column: a range of numbers, both ends included, or one of some texts."""

    column: str
    low: float = -math.inf
    high: float = math.inf
    texts: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.texts:
            return f"{self.column}={'|'.join(self.texts)}"
        low, high = (f"{end:.15g}" if math.isfinite(end) else "" for end in (self.low, self.high))
        return f"{self.column}={low}..{high}"


def parse_conditions(text: str) -> tuple[BallCondition, ...]:
    """Conditions such as `kind=stroke speed_mps=5..7 outcome=net|out error_m=.3..`, separated by blanks; quote a
    text with a blank.

    Raises:
        ConfigError: if there is no such column, or a range is none.
    """
    try:
        return tuple(_condition(one) for one in shlex.split(text))
    except ValueError as error:
        raise ConfigError(
            "not a condition on balls", expected="a second quotation mark", got=repr(text[:80])
        ) from error


def _condition(text: str) -> BallCondition:
    column, is_one, value = text.partition("=")
    if not is_one or not value or column not in COLUMNS:
        expected = f"COLUMN=FROM..TO or COLUMN=TEXT|TEXT, and of the columns {', '.join(COLUMNS)}"
        raise ConfigError("not a condition on balls", expected=expected, got=repr(text[:80]))
    if column not in (*INTEGERS, *NUMBERS):
        return BallCondition(column, texts=tuple(value.split("|")))
    low, is_range, high = value.partition("..")
    try:
        ends = (float(low or -math.inf), float(high or math.inf)) if is_range else (float(low), float(low))
    except ValueError as error:
        raise ConfigError(
            "not a range", expected="FROM..TO, or a number", got=repr(value[:80]), where=column
        ) from error
    return BallCondition(column, *ends)


def select_rows(table: pa.Table, conditions: Sequence[BallCondition]) -> NDArray[np.int64]:
    """Numbers of the rows that meet all conditions, ascending; what is not known meets none."""
    keep = np.ones(len(table), np.bool_)
    for one in conditions:
        column = table.column(one.column).combine_chunks()
        if one.texts:
            coded = column.dictionary_encode()
            wanted = [text in one.texts for text in coded.dictionary.to_pylist()]
            keep &= np.array([*wanted, False])[coded.indices.fill_null(-1).to_numpy()]  # -1: the last, not wanted
        else:
            # In NumPy: an expression of pyarrow narrows the limits to 32 bits, and fails for most times.
            values = column.to_numpy(zero_copy_only=False)
            keep &= (values >= one.low) & (values <= one.high)
    return np.flatnonzero(keep)
