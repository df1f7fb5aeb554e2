"""Everything that a label store says, wherever it lies: a file that was copied, or sent, or is on another disk."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from core.errors import LabelError
from labels.database.connection import DamagedStoreError, open_to_read, sqlite_errors
from labels.database.contact_rows import DeletedTimes, contact_of, current_contacts, deleted_times
from labels.database.edit_log import NEWEST
from labels.database.folder import Layer, store_path
from labels.database.reading import salvage
from labels.database.rows import Values, current_rows, label_of, values_before_settling
from labels.database.schema import recording_of
from labels.model import ContactLabel, Label
from labels.store import LabelStore, find_layers


@dataclass(frozen=True, slots=True, eq=False)
class StoreContents:
    """The labels of a store as they were when it was read."""

    recording_uuid: str
    layers: Mapping[Layer, Mapping[int, Label]]
    """By time."""
    first: Mapping[Layer, Mapping[int, Label]]
    """What was said before a conflict was settled, or a label left out by a merge, by time; only there."""
    notes: tuple[str, ...] = ()
    """What could not be read."""
    contacts: Mapping[Layer, tuple[ContactLabel, ...]] = field(default_factory=dict)
    """By time; every layer has an entry."""
    deleted: Mapping[Layer, DeletedTimes] = field(default_factory=dict)
    """Every layer has an entry."""


def read_store(source: Path) -> StoreContents:
    """What is in a store file, or in the folder of a recording's labels; of a damaged one, what can be read.

    The store is not written to, and where no program has it open, nothing is made beside it.

    Raises:
        LabelError: if there is none, or it cannot be read.
    """
    if source.is_dir():
        return _read_folder(source.absolute())
    if not source.is_file():
        raise LabelError(
            "no such label store", where=source, remedy="name a labels.sqlite, or the folder that it is in"
        )
    try:
        with closing(open_to_read(source, untouched=True)) as db:
            return _read_database(db, source, ())
    except DamagedStoreError:
        db, notes = salvage(source)
        with closing(db):
            return _read_database(db, source, notes)


def layers_of_store(path: Path) -> tuple[Layer, ...]:
    """Whose labels of what a store file holds; nothing else of it is read.

    Raises:
        LabelError: if it is not a store, or cannot be read.
    """
    with closing(open_to_read(path, untouched=True)) as db, sqlite_errors(path, "cannot read the labels"):
        uuid = recording_of(db, path)
        rows = db.execute("SELECT camera, annotator, blind FROM layers ORDER BY annotator, camera, blind").fetchall()
    return tuple(Layer(uuid, camera, annotator, bool(blind)) for camera, annotator, blind in rows)


def copy_store(folder: Path, recording_uuid: str, target: Path) -> int:
    """Write all that is stored of a recording's labels, with every change, into one new file; number of its labels.

    Others may write to the store meanwhile: the copy is of one moment, and complete without a log beside it.

    Raises:
        LabelError: if there are no labels, or they cannot be read or written.
    """
    source = store_path(folder, recording_uuid)
    if not source.is_file():
        raise LabelError("no labels of this recording", remedy="label something first")
    with (
        closing(open_to_read(source)) as db,
        sqlite_errors(target, "cannot copy the labels"),
        closing(sqlite3.connect(target, isolation_level=None)) as copy,
    ):
        db.backup(copy)
        copy.execute("PRAGMA journal_mode = DELETE")
        return int(copy.execute("SELECT count(*) FROM labels").fetchone()[0])


def _read_folder(folder: Path) -> StoreContents:
    uuid = unquote(folder.name)
    layers = find_layers(folder.parent, uuid)
    if not layers:
        raise LabelError("no labels in this folder", where=folder, remedy="name a labels.sqlite")
    found: dict[Layer, dict[int, Label]] = {}
    first: dict[Layer, dict[int, Label]] = {}
    contacts: dict[Layer, tuple[ContactLabel, ...]] = {}
    deleted: dict[Layer, DeletedTimes] = {}
    notes: list[str] = []
    for layer in layers:
        with LabelStore.read(folder.parent, layer) as store:
            found[layer] = {label.t_us: label for label in store.all()}
            first[layer] = {label.t_us: label for label in store.before_settling()}
            contacts[layer] = store.contacts()
            deleted[layer] = store.deleted()
        notes += [note for note in store.notes if note not in notes]
    return StoreContents(uuid, found, first, tuple(notes), contacts, deleted)


def _read_database(db: sqlite3.Connection, path: Path, notes: tuple[str, ...]) -> StoreContents:
    found: dict[Layer, dict[int, Label]] = {}
    first: dict[Layer, dict[int, Label]] = {}
    contacts: dict[Layer, tuple[ContactLabel, ...]] = {}
    deleted: dict[Layer, DeletedTimes] = {}
    all_notes = list(notes)
    with sqlite_errors(path, "cannot read the labels"):
        uuid = recording_of(db, path)
        for number, camera, annotator, blind in db.execute("SELECT * FROM layers").fetchall():
            rows = [(row[0], row[2:]) for row in current_rows(db, number, upto=NEWEST)]
            layer = Layer(uuid, camera, annotator, bool(blind))
            found[layer] = _readable_labels(rows, path, all_notes)
            before = values_before_settling(db, number, upto=NEWEST)
            first[layer] = _readable_labels(before, path, all_notes)
            contacts[layer] = _readable_contacts(current_contacts(db, number, upto=NEWEST), path, all_notes)
            deleted[layer] = deleted_times(db, number)
    return StoreContents(uuid, found, first, tuple(all_notes), contacts, deleted)


def _readable_labels(rows: Sequence[tuple[int, Values | None]], path: Path, notes: list[str]) -> dict[int, Label]:
    labels = {}
    for t_us, values in rows:
        if values is None:
            continue
        try:
            labels[t_us] = label_of(t_us, values)
        except LabelError as error:
            notes.append(f"{path}: left out: {error}")
    return labels


def _readable_contacts(rows: Sequence[tuple[int, Values]], path: Path, notes: list[str]) -> tuple[ContactLabel, ...]:
    contacts = []
    for t_us, values in rows:
        try:
            contacts.append(contact_of(t_us, values))
        except LabelError as error:
            notes.append(f"{path}: left out: {error}")
    return tuple(contacts)
