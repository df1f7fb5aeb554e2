"""Label stores to look at: whose labels there are, what can still be read of damaged ones, journals of version 1."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from core.errors import LabelError
from core.text import counted
from labels.database.connection import DamagedStoreError, distrust, open_to_read, sqlite_errors, transaction
from labels.database.folder import Layer, journals_in, stores_in
from labels.database.migration import replay
from labels.database.schema import create_tables, holds_contacts, recording_of, upgrade_tables
from labels.journal import read_journal

SQLITE_MAGIC: Final = b"SQLite format 3\0"
KEYS: Final = {
    "layers": "layer",
    "edits": "edit",
    "changes": "layer, t_us, edit",
    "rejections": "edit",
    "contact_changes": "layer, t_us, edit",
}
"""Tables, and the order in which each lies in the file."""


def salvage(path: Path) -> tuple[sqlite3.Connection, tuple[str, ...]]:
    """A store in memory with every row that can be read, and what was lost, for a person to know.

    Raises:
        LabelError: if not even the beginning of the file can be read.
    """
    try:
        return _salvage(path)
    except DamagedStoreError as error:  # its advice is to do what was just tried
        with path.open("rb") as file:
            is_database = file.read(len(SQLITE_MAGIC)) == SQLITE_MAGIC
        what = "a label store of which nothing can be read" if is_database else "not a label store"
        raise LabelError(what, got=error.__cause__, where=path) from error


def _salvage(path: Path) -> tuple[sqlite3.Connection, tuple[str, ...]]:
    with (
        contextlib.closing(open_to_read(path, untouched=True)) as damaged,
        sqlite_errors(path, "cannot read the labels"),
    ):
        saved = memory_store(recording_of(damaged, path))
        tables = [table for table in KEYS if table != "contact_changes" or holds_contacts(damaged)]
        broken = [table for table in tables if not _copy_table(damaged, saved, table)]
        kept = saved.execute("SELECT count(*) FROM labels").fetchone()[0]
    what = f"damaged in {', '.join(broken)}" if broken else "damaged"
    return saved, (f"{path}: {what}; {counted(kept, 'label')} could be read, others may be lost",)


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


ANNOTATORS_SQL: Final = """
SELECT DISTINCT annotator FROM layers WHERE NOT blind AND EXISTS (SELECT 1 FROM edits WHERE edits.layer = layers.layer)
"""


def find_layers(folder: Path, recording_uuid: str | None = None) -> tuple[Layer, ...]:
    """Every layer in a folder of labels, by recording, camera and annotator.

    Raises:
        LabelError: if a store cannot be read.
    """
    layers = set(journals_in(folder, recording_uuid))
    for path in stores_in(folder, recording_uuid):
        uuid = unquote(path.parent.name)
        with closing(readable(path)) as db, sqlite_errors(path, "cannot read the labels"):
            rows = db.execute("SELECT camera, annotator, blind FROM layers").fetchall()
        layers |= {Layer(uuid, camera, annotator, bool(blind)) for camera, annotator, blind in rows}
    return tuple(sorted(layers, key=lambda layer: (layer.recording_uuid, layer.camera, layer.annotator, layer.blind)))


def find_annotators(folder: Path, recording_uuid: str) -> tuple[str, ...]:
    """Who has labelled a recording, by name; not who has only begun a layer, nor second looks.

    Raises:
        LabelError: if a store cannot be read.
    """
    names = {layer.annotator for layer in journals_in(folder, recording_uuid) if not layer.blind}
    for path in stores_in(folder, recording_uuid):
        with closing(readable(path)) as db, sqlite_errors(path, "cannot read the labels"):
            names |= {name for (name,) in db.execute(ANNOTATORS_SQL)}
    return tuple(sorted(names))


def has_labels(folder: Path, layer: Layer) -> bool:
    """Whether somebody has begun a layer."""
    return layer in find_layers(folder, layer.recording_uuid)


def readable(path: Path) -> sqlite3.Connection:
    """A store to read from; of a damaged one, what can be read."""
    try:
        return open_to_read(path)
    except DamagedStoreError:
        return salvage(path)[0]


def read_with_journal(path: Path, layer: Layer, journal: Path) -> tuple[sqlite3.Connection, tuple[str, ...]]:
    """A store in memory: what is in the file, and a journal that nobody has taken over yet."""
    db = memory_store(layer.recording_uuid)
    if path.is_file():
        with closing(open_to_read(path)) as file, sqlite_errors(path, "cannot read the labels"):
            file.backup(db)
        with transaction(db):
            upgrade_tables(db)
    with transaction(db):
        return db, tuple(replay(db, read_journal(journal), layer, journal))
