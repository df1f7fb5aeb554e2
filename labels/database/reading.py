"""Label stores to look at: whose labels there are, and layers that are damaged, or still in a journal of version 1."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from labels.database.connection import DamagedStoreError, open_to_read, telling, transaction
from labels.database.folder import Layer, journals_in, stores_in
from labels.database.migration import replay
from labels.database.salvage import memory_store, salvage
from labels.journal import read_journal

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
        with closing(readable(path)) as db, telling(path, "cannot read the labels"):
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
        with closing(readable(path)) as db, telling(path, "cannot read the labels"):
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
        with closing(open_to_read(path)) as file, telling(path, "cannot read the labels"):
            file.backup(db)
    with transaction(db):
        return db, tuple(replay(db, read_journal(journal), layer, journal))
