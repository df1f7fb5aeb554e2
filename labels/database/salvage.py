"""What can still be read of a damaged label store: rows before the damage, and rows behind it."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from labels.database.connection import distrust, open_to_read, telling
from labels.database.schema import create_tables, recording_of

KEYS: Final = {"layers": "layer", "edits": "edit", "changes": "layer, t_us, edit", "rejections": "edit"}
"""Tables, and the order in which each lies in the file."""


def salvage(path: Path) -> tuple[sqlite3.Connection, tuple[str, ...]]:
    """A store in memory with every row that can be read, and what was lost, for a person to know.

    Raises:
        LabelError: if not even the beginning of the file can be read.
    """
    with contextlib.closing(open_to_read(path, untouched=True)) as damaged, telling(path, "cannot read the labels"):
        saved = memory_store(recording_of(damaged, path))
        broken = [table for table in KEYS if not _copy_table(damaged, saved, table)]
        kept = saved.execute("SELECT count(*) FROM labels").fetchone()[0]
    what = f"damaged in {', '.join(broken)}" if broken else "damaged"
    return saved, (f"{path}: {what}; {kept} labels could be read, others may be lost",)


def memory_store(recording_uuid: str) -> sqlite3.Connection:
    """An empty store that is no file."""
    db = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False)
    distrust(db)
    create_tables(db, recording_uuid)
    return db


def _copy_table(damaged: sqlite3.Connection, saved: sqlite3.Connection, table: str) -> bool:
    """From both ends up to what cannot be read; whether that was everything."""
    width = len(saved.execute(f"SELECT * FROM {table} LIMIT 0").description)
    places = ", ".join("?" * width)
    forward = _Readable(damaged, f"SELECT * FROM {table} ORDER BY {KEYS[table]}")
    _keep(saved, table, places, forward)
    if forward.whole:
        return True
    descending = ", ".join(f"{key} DESC" for key in KEYS[table].split(", "))
    _keep(saved, table, places, _Readable(damaged, f"SELECT * FROM {table} ORDER BY {descending}"))
    return False


def _keep(saved: sqlite3.Connection, table: str, places: str, rows: _Readable) -> None:
    for row in rows:
        with contextlib.suppress(sqlite3.IntegrityError):  # a value that damage has made impossible
            saved.execute(f"INSERT OR IGNORE INTO {table} VALUES ({places})", row)


class _Readable:
    """Rows up to the first that cannot be read."""

    def __init__(self, db: sqlite3.Connection, query: str) -> None:
        self._db, self._query = db, query
        self.whole = False

    def __iter__(self) -> Iterator[tuple]:
        with contextlib.suppress(sqlite3.DatabaseError, UnicodeDecodeError):
            yield from self._db.execute(self._query)
            self.whole = True
