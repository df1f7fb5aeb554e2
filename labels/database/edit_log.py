"""Edits, undo and redo as rows that are only ever added. Each function runs inside a transaction of its caller."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from labels.database.contact_rows import (
    CONTACT_COLUMNS,
    LISTED_CONTACT,
    NO_CONTACT,
    contact_at,
    values_of_contact,
    values_of_rejection,
)
from labels.database.rows import COLUMNS, LISTED, NO_LABEL, Values, value_at, values_of
from labels.database.schema import holds_contacts
from labels.model import ContactLabel, Label

Kind = str
EDIT, UNDO, REDO = "edit", "undo", "redo"
"""Stores have rows of the kind "rejected proposal", too: until a rejection was a step of undo, it was of that kind."""
NEWEST: Final = 2**62
"""After every edit that there is."""
_ADD = f"INSERT INTO changes (layer, t_us, edit, {LISTED}) VALUES (?, ?, ?{', ?' * len(COLUMNS)})"
_ADD_CONTACT = (
    f"INSERT INTO contact_changes (layer, t_us, edit, {LISTED_CONTACT}) VALUES (?, ?, ?{', ?' * len(CONTACT_COLUMNS)})"
)
_ADD_REJECTION = "INSERT INTO rejections (edit, t_us, x_px, y_px, r_px, detector) VALUES (?, ?, ?, ?, ?, ?)"


@dataclass(frozen=True, slots=True)
class Writer:
    """Who writes: a layer, and which of the programs or browsers that write it."""

    layer: int
    session: str
    """Empty: undo takes back whatever was done last in the layer. Else only what this session did."""
    tool: str


@dataclass(frozen=True, slots=True)
class UndoStep:
    """What an undo or a redo did."""

    touched_us: tuple[int, ...] = ()
    left_us: tuple[int, ...] = ()
    """Times that somebody else has changed since: they stay as that other left them."""

    @property
    def done(self) -> bool:
        """Whether there was anything to take back or to bring back."""
        return bool(self.touched_us or self.left_us)


class SessionHistory:
    """What a session can take back and bring back, followed as rows are added."""

    def __init__(self) -> None:
        self.done: list[int] = []
        self.undone: list[int] = []
        self._seen = 0

    def follow(self, db: sqlite3.Connection, writer: Writer) -> None:
        """Take up what was added since."""
        mine = (writer.session,) if writer.session else ()
        rows = db.execute(
            f"SELECT edit, kind, of FROM edits WHERE layer = ? {'AND session = ?' if mine else ''} "
            "AND edit > ? ORDER BY edit",
            (writer.layer, *mine, self._seen),
        )
        for edit, kind, of in rows:
            self._seen = edit
            if kind == EDIT:
                self.done.append(edit)
                self.undone.clear()
            elif kind == UNDO and self.done[-1:] == [of]:
                self.undone.append(self.done.pop())
            elif kind == REDO and self.undone[-1:] == [of]:
                self.done.append(self.undone.pop())


def find_layer(db: sqlite3.Connection, camera: str, annotator: str, blind: bool) -> int | None:
    """The number of a layer."""
    names = (camera, annotator, int(blind))
    row = db.execute("SELECT layer FROM layers WHERE camera = ? AND annotator = ? AND blind = ?", names).fetchone()
    return None if row is None else row[0]


def make_layer(db: sqlite3.Connection, camera: str, annotator: str, blind: bool) -> int:
    """The number of a layer, which is added if there is none."""
    known = find_layer(db, camera, annotator, blind)
    if known is not None:
        return known
    made = db.execute(
        "INSERT INTO layers (camera, annotator, blind) VALUES (?, ?, ?)", (camera, annotator, int(blind))
    ).lastrowid
    assert made is not None
    return made


def newest_edit(db: sqlite3.Connection, layer: int, *, after: int = 0) -> int:
    """The number of the latest edit of a layer; `after` if there is none behind that one."""
    # The plus keeps SQLite from walking through all edits of the layer by its index.
    query = "SELECT max(edit) FROM edits WHERE edit > ? AND +layer = ?"
    return db.execute(query, (after, layer)).fetchone()[0] or after


def add_edit(
    db: sqlite3.Connection,
    writer: Writer,
    put: Iterable[Label],
    delete: Iterable[int],
    *,
    made_at_us: int | None = None,
    put_contacts: Iterable[ContactLabel] = (),
    delete_contacts: Iterable[int] = (),
    reject_contacts: Iterable[ContactLabel] = (),
) -> tuple[int, ...]:
    """One act of a person; returns the times it touches. Times without a label or contact are not deleted."""
    gone = [t_us for t_us in dict.fromkeys(delete) if value_at(db, writer.layer, t_us, upto=NEWEST) is not None]
    changes = [*((label.t_us, values_of(label)) for label in put), *((t_us, NO_LABEL) for t_us in gone)]
    ended = [
        t_us
        for t_us in dict.fromkeys(delete_contacts)
        if (values := contact_at(db, writer.layer, t_us, upto=NEWEST)) is not None and values[0] is not None
    ]
    contacts = [(contact.t_us, values_of_contact(contact)) for contact in put_contacts]
    contacts += [(contact.t_us, values_of_rejection(contact)) for contact in reject_contacts]
    contacts += [(t_us, NO_CONTACT) for t_us in ended]
    if changes or contacts:
        edit = _add_row(db, writer, EDIT, None, made_at_us)
        _add_changes(db, writer.layer, edit, changes)
        _add_changes(db, writer.layer, edit, contacts, _ADD_CONTACT)
    return tuple(t_us for t_us, _ in (*changes, *contacts))


def add_rejection(
    db: sqlite3.Connection, writer: Writer, t_us: int, x_px: float, y_px: float, r_px: float | None, detector: str
) -> None:
    """A proposal that a person found wrong; nothing if it was said already. It changes no label.

    Args:
        db: the store, inside a transaction.
        writer: layer and session.
        t_us: time of the proposal.
        x_px: its column.
        y_px: its row.
        r_px: its radius; None: not known.
        detector: what proposed it.
    """
    if (t_us, detector) in current_rejected(db, writer.layer):
        return  # said twice, it would be taken back by the undo of either
    edit = _add_row(db, writer, EDIT, None)
    db.execute(_ADD_REJECTION, (edit, t_us, x_px, y_px, r_px, detector))


def current_rejected(db: sqlite3.Connection, layer: int) -> frozenset[tuple[int, str]]:
    """(time, detector) of the proposals of a layer that a person found wrong, but for those that were taken back."""
    rows = db.execute(
        "SELECT t_us, detector, max(edit), kind FROM rejections JOIN edits USING (edit) WHERE layer = ? "
        "GROUP BY t_us, detector HAVING kind <> ?",
        (layer, UNDO),
    )
    return frozenset((t_us, detector) for t_us, detector, _, _ in rows)


def step_back(db: sqlite3.Connection, writer: Writer, history: SessionHistory, *, redo: bool = False) -> UndoStep:
    """Take back the session's latest edit that stands, or bring back the one it took back last."""
    history.follow(db, writer)
    candidates = history.undone if redo else history.done
    if not candidates:
        return UndoStep()
    edit = candidates[-1]
    changes, left = _changes_of_step(db, writer.layer, edit, "changes", redo)
    contacts, left_contacts = (
        _changes_of_step(db, writer.layer, edit, "contact_changes", redo) if holds_contacts(db) else ([], [])
    )
    rejections, left_rejections = _rejections_of_step(db, writer.layer, edit)
    made = _add_row(db, writer, REDO if redo else UNDO, edit)
    _add_changes(db, writer.layer, made, changes)
    _add_changes(db, writer.layer, made, contacts, _ADD_CONTACT)
    db.executemany(_ADD_REJECTION, ((made, *values) for values in rejections))
    touched = (*changes, *contacts, *rejections)
    return UndoStep(tuple(t_us for t_us, *_ in touched), (*left, *left_contacts, *left_rejections))


_Rejection = tuple[int, float, float, float | None, str]
"""Time, column, row, radius and detector of a proposal that is wrong."""


def _rejections_of_step(db: sqlite3.Connection, layer: int, edit: int) -> tuple[list[_Rejection], list[int]]:
    """The rejection of an edit, if it has one, for an undo or redo to say again, or its time if others said it since.

    What it says is in the kind of the undo's or redo's row of `edits`: an undo's rejection is none.
    """
    row = db.execute("SELECT t_us, x_px, y_px, r_px, detector FROM rejections WHERE edit = ?", (edit,)).fetchone()
    if row is None:
        return [], []
    newest = db.execute(
        "SELECT max(edit), of FROM rejections JOIN edits USING (edit) WHERE layer = ? AND t_us = ? AND detector = ?",
        (layer, row[0], row[-1]),
    ).fetchone()
    return ([row], []) if edit in newest else ([], [row[0]])


def _changes_of_step(
    db: sqlite3.Connection, layer: int, edit: int, table: str, redo: bool
) -> tuple[list[tuple[int, Values]], list[int]]:
    """What an undo or redo of an edit writes into one table, and the times that others have changed since."""
    look, nothing = (value_at, NO_LABEL) if table == "changes" else (contact_at, NO_CONTACT)
    changes: list[tuple[int, Values]] = []
    left: list[int] = []
    for (t_us,) in db.execute(f"SELECT t_us FROM {table} WHERE edit = ? ORDER BY t_us", (edit,)).fetchall():
        before, after = look(db, layer, t_us, upto=edit - 1), look(db, layer, t_us, upto=edit)
        found, wanted = (before, after) if redo else (after, before)
        if look(db, layer, t_us, upto=NEWEST) == found:
            changes.append((t_us, wanted or nothing))
        else:
            left.append(t_us)
    return changes, left


def _add_row(db: sqlite3.Connection, writer: Writer, kind: Kind, of: int | None, made_at_us: int | None = None) -> int:
    now_us = time.time_ns() // 1000 if made_at_us is None else made_at_us
    row = (writer.layer, writer.session, kind, of, now_us, writer.tool)
    made = db.execute("INSERT INTO edits (layer, session, kind, of, made_at_us, tool) VALUES (?, ?, ?, ?, ?, ?)", row)
    assert made.lastrowid is not None
    return made.lastrowid


def _add_changes(
    db: sqlite3.Connection, layer: int, edit: int, changes: Iterable[tuple[int, Values]], add: str = _ADD
) -> None:
    db.executemany(add, ((layer, t_us, edit, *values) for t_us, values in changes))
