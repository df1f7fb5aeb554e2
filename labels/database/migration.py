"""Journals of version 1 taken over into the store of their recording; each is kept beside it under another name."""

from __future__ import annotations

import hashlib
import os
import sqlite3
from pathlib import Path
from typing import Final

from core.errors import LabelError
from core.files import POSIX, beside, lock_descriptor, numbered, sync
from labels.database.connection import sqlite_errors, transaction
from labels.database.edit_log import SessionHistory, Writer, add_edit, make_layer, step_back
from labels.database.folder import Layer, journals_in
from labels.journal import FORMAT, SCHEMA, JournalLines, Json, label_from_json, read_journal

BACKUP: Final = ".backup"


def migrate(db: sqlite3.Connection, folder: Path, recording_uuid: str) -> tuple[str, ...]:
    """Take over every journal of a recording, each in one step; returns what a person should know.

    Raises:
        LabelError: if another program writes one of them, or it is not ours.
    """
    notes: list[str] = []
    for layer in journals_in(folder, recording_uuid):
        path = layer.journal(folder)
        if not POSIX:  # no version that wrote them ran there, and what is locked could not be read
            notes += _take_over(db, layer, path)
            continue
        try:
            file = os.open(path, os.O_RDONLY)
        except FileNotFoundError:
            continue  # another program has just taken it over
        try:
            lock_descriptor(file)
            notes += _take_over(db, layer, path)
        except BlockingIOError as error:
            remedy = "close it: an earlier version writes them otherwise"
            raise LabelError("another program is writing these labels", where=path, remedy=remedy) from error
        finally:
            os.close(file)
    return tuple(notes)


def _take_over(db: sqlite3.Connection, layer: Layer, path: Path) -> list[str]:
    notes: list[str] = []
    with sqlite_errors(path, "cannot take over the labels of an earlier version"), transaction(db):
        if not path.is_file():
            return []  # taken over while this program waited
        name = f"journal {path.parent.name}/{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        known = db.execute("SELECT count(*) FROM about WHERE name = ?", (name,)).fetchone()[0]
        if not known:  # else a kill came between the end of this block and the new name
            notes += replay(db, read_journal(path), layer, path)
            db.execute("INSERT INTO about VALUES (?, 'taken over')", (name,))
    backup = next(free for ending in numbered(BACKUP) if not (free := beside(path, "", ending)).exists())
    path.rename(backup)
    sync(path.parent)
    return [*notes, f"labels of an earlier version were taken over; the old file is kept as {backup}"]


def replay(db: sqlite3.Connection, lines: JournalLines, layer: Layer, path: Path) -> list[str]:
    """Do again what a journal says, inside the caller's transaction; returns what is wrong with it.

    Raises:
        LabelError: if it is of a later version, or of something else.
    """
    notes = [f"{path}:{number}: damaged line, left out" for number in lines.damaged]
    number = make_layer(db, layer.camera, layer.annotator, layer.blind)
    history = SessionHistory()
    edits: dict[object, int] = {}
    for record in lines.records:
        match record.get("op"):
            case "open":
                _check_header(record, layer, path)
            case "edit":
                if _replay_edit(db, number, record, path):
                    history.follow(db, Writer(number, "", ""))
                    edits[record.get("seq")] = history.done[-1]
            case "undo" | "redo" as act:
                able = history.undone if act == "redo" else history.done
                # The edit that it undoes was a damaged line: undoing the one before would take back another.
                if not able or edits.get(record.get("of")) != able[-1]:
                    notes.append(f"{path}: {act} of edit {record.get('of')}, which is damaged; left out")
                    continue
                step_back(db, Writer(number, "", ""), history, redo=act == "redo")
                history.follow(db, Writer(number, "", ""))
            case other:
                raise LabelError("unknown operation", got=repr(other), where=path, remedy="use a later version")
    return notes


def _replay_edit(db: sqlite3.Connection, layer: int, record: Json, path: Path) -> tuple[int, ...]:
    seq, put, delete = record.get("seq"), record.get("put"), record.get("delete")
    if not isinstance(seq, int) or not isinstance(put, list) or not isinstance(delete, list):
        raise LabelError("not an edit", got=sorted(record), where=path)
    try:
        labels = [label_from_json(values) for values in put]
    except LabelError as error:
        raise LabelError(str(error), where=f"{path} edit {seq}") from error
    made = labels[0].provenance if labels else None
    writer = Writer(layer, "", made.tool if made is not None else "")
    return add_edit(db, writer, labels, (int(t_us) for t_us in delete), made_at_us=made.made_at_us if made else 0)


def _check_header(record: Json, layer: Layer, path: Path) -> None:
    schema = record.get("schema")
    if record.get("format") != FORMAT or not isinstance(schema, int) or schema > SCHEMA:
        got = f"{record.get('format')} schema {schema}"
        raise LabelError(
            "labels of another version", expected=f"{FORMAT} up to {SCHEMA}", got=got, where=path, remedy="update"
        )
    expected = {
        "recording": layer.recording_uuid,
        "camera": layer.camera,
        "annotator": layer.annotator,
        "blind": layer.blind,
    }
    found = {name: record.get(name) for name in expected}
    if found != expected:
        raise LabelError("labels of something else", expected=expected, got=found, where=path)
