"""What is in the file of a label store, and whether a file is one: its tables are ours to the letter, or it is refused.

A file from elsewhere may hold triggers and views that do something else than their names say. Nothing of a schema is
run before all of it has been compared with ours.
"""

from __future__ import annotations

import functools
import sqlite3
from pathlib import Path
from typing import Final

from core.errors import LabelError

APPLICATION_ID: Final = 0x52534C42
"""`RSLB` in the header of the file: what `file` and SQLite's own tools see."""
VERSION: Final = 2
"""Version of the tables. Version 1 were journals of JSON lines."""

TABLES: Final = """
CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT, WITHOUT ROWID;

CREATE TABLE layers (
  layer INTEGER PRIMARY KEY,
  camera TEXT NOT NULL,
  annotator TEXT NOT NULL,
  blind INTEGER NOT NULL CHECK (blind IN (0, 1)),
  UNIQUE (camera, annotator, blind)
) STRICT;

CREATE TABLE edits (
  edit INTEGER PRIMARY KEY,
  layer INTEGER NOT NULL REFERENCES layers,
  session TEXT NOT NULL,
  kind TEXT NOT NULL CHECK (kind IN ('edit', 'undo', 'redo', 'rejected proposal')),
  of INTEGER,
  made_at_us INTEGER NOT NULL,
  tool TEXT NOT NULL
) STRICT;
CREATE INDEX edits_of_layer ON edits (layer, session);

CREATE TABLE changes (
  layer INTEGER NOT NULL REFERENCES layers,
  t_us INTEGER NOT NULL CHECK (t_us >= 0),
  edit INTEGER NOT NULL REFERENCES edits,
  state TEXT CHECK (state IN ('visible', 'partly_occluded', 'occluded', 'out_of_frame', 'no_ball')),
  x_px REAL,
  y_px REAL,
  r_px REAL CHECK (r_px > 0),
  cov_xx_px2 REAL,
  cov_xy_px2 REAL,
  cov_yy_px2 REAL,
  source TEXT,
  annotator TEXT,
  made_at_us INTEGER,
  tool TEXT,
  detector TEXT,
  window_start_us INTEGER,
  window_end_us INTEGER,
  rendering TEXT,
  time_spent_ms INTEGER,
  PRIMARY KEY (layer, t_us, edit)
) STRICT, WITHOUT ROWID;
CREATE INDEX changes_of_edit ON changes (edit);

CREATE TABLE rejections (
  edit INTEGER PRIMARY KEY REFERENCES edits,
  t_us INTEGER NOT NULL,
  x_px REAL NOT NULL,
  y_px REAL NOT NULL,
  r_px REAL CHECK (r_px > 0),
  detector TEXT NOT NULL
) STRICT;

CREATE VIEW labels AS
SELECT l.camera, l.annotator AS whose, l.blind, c.*
FROM changes c JOIN layers l USING (layer)
WHERE c.state IS NOT NULL
  AND c.edit = (SELECT max(d.edit) FROM changes d WHERE d.layer = c.layer AND d.t_us = c.t_us);

CREATE VIEW history AS
SELECT e.edit, e.kind, e.of, l.camera, l.annotator, l.blind, e.session, e.tool,
  datetime(e.made_at_us / 1000000, 'unixepoch') AS made_at_utc, c.t_us, c.state, c.x_px, c.y_px, c.r_px, c.source
FROM edits e JOIN layers l USING (layer) LEFT JOIN changes c USING (edit);
"""
"""Rows are only ever added. A change without a state makes a time unchecked again."""

Entry = tuple[str, str, str, str]
"""Type, name, table and text of an entry of the schema."""


def create_tables(db: sqlite3.Connection, recording_uuid: str) -> None:
    """Make an empty file a label store; the caller's transaction holds it all."""
    for statement in TABLES.split(";"):
        if statement.strip():
            db.execute(statement)
    db.execute("INSERT INTO about VALUES ('recording', ?)", (recording_uuid,))
    db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    db.execute(f"PRAGMA user_version = {VERSION}")


def is_empty(db: sqlite3.Connection) -> bool:
    """Whether nothing was ever made in a file."""
    return not db.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]


def check_schema(db: sqlite3.Connection, path: Path) -> None:
    """Compare all of a file's schema with ours; runs none of it.

    Raises:
        LabelError: if it is of a later version, or anything is missing, other or too much.
    """
    (application,), (version,) = (
        db.execute(f"PRAGMA {name}").fetchone() for name in ("application_id", "user_version")
    )
    if not application and is_empty(db) and _keeps_log(path):
        raise LabelError(
            "a label store without its log, which holds the labels",
            expected=f"{path.name}-wal beside it",
            where=path,
            remedy="copy both files, or close Rallyscope there first and copy it again",
        )
    if application != APPLICATION_ID:
        raise LabelError(
            "not a label store", expected="a file that this program made", got="another database", where=path
        )
    if version > VERSION:
        expected = f"up to version {VERSION}"
        raise LabelError("labels of another version", expected=expected, got=version, where=path, remedy="update")
    # What is too much counts as well: a trigger or a view would run with our statements.
    odd = sorted(str(name) for _, name, _, _ in _entries(db) ^ _our_entries())
    if odd:
        raise LabelError(
            "a label store with other tables than ours; nothing of it is read",
            got=f"differing: {', '.join(map(repr, odd[:5]))}",
            where=path,
        )


def recording_of(db: sqlite3.Connection, path: Path) -> str:
    """The recording that a store is about.

    Raises:
        LabelError: if it does not say.
    """
    row = db.execute("SELECT value FROM about WHERE name = 'recording'").fetchone()
    if row is None:
        raise LabelError("a label store that does not say of which recording", where=path)
    return row[0]


def _keeps_log(path: Path) -> bool:
    """Whether a file says that its changes stand in a log beside it first (SQLite's file format, 1.3.3)."""
    try:
        with path.open("rb") as file:
            return file.read(20)[18:20] == b"\x02\x02"
    except OSError:
        return False


def _entries(db: sqlite3.Connection) -> set[Entry]:
    # SQLite keeps names that begin with sqlite_ for itself: indices of keys, statistics.
    found = db.execute("SELECT type, name, tbl_name, sql FROM sqlite_schema").fetchall()
    return {entry for entry in found if not str(entry[1]).startswith("sqlite_")}


@functools.cache
def _our_entries() -> frozenset[Entry]:
    db = sqlite3.connect(":memory:", isolation_level=None)
    try:
        create_tables(db, "")
        return frozenset(_entries(db))
    finally:
        db.close()
